#include "ops/check.h"

#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

#include "ops/check_report.h"
#include "runtime/error.h"
#include "runtime/threads.h"
#include "tests/temporary_folder.h"

using namespace slide;
using ops::KernelCheck;

namespace {

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

using Body = std::function<void(std::span<const float> x, std::span<float> y, std::span<std::byte> scratch)>;

/// A kernel that does what a test wants it to.
class TestKernel : public Kernel {
 public:
  TestKernel(Body body, double factor, Domain domain = {})
      : body_(std::move(body)), factor_(factor), domain_(domain) {}
  std::string_view name() const override { return "double.test"; }
  Isa isa() const override { return Isa::kBaseline; }
  bool supports(const Op&, std::span<const Shape>, const Shape&) const override { return true; }
  std::size_t scratch_bytes(const Op&, std::span<const Shape>, const Shape&) const override { return 10; }
  double error_factor(const Op&, std::span<const Shape>) const override { return factor_; }
  Domain domain() const override { return domain_; }
  void run(const Op&, std::span<const Tensor> inputs, Tensor& output, const KernelCall& call) const override {
    body_(inputs[0].data<float>(), output.mutable_data<float>(), call.scratch);
  }

 private:
  Body body_;
  double factor_;
  Domain domain_;
};

/// y = 2x.
class DoubleOp : public Op {
 public:
  std::string_view type() const override { return "double"; }
  Shape infer(std::span<const Shape> inputs) const override { return inputs[0]; }
  void reference(std::span<const Tensor> inputs, Tensor& output) const override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(output.count()); ++i)
      output.mutable_data<double>()[i] = 2 * inputs[0].data<double>()[i];
  }
  std::span<const Kernel* const> kernels() const override { return {}; }
};

KernelCheck check(const std::vector<float>& x, const Body& body, double factor = 1, Domain domain = {}) {
  const DoubleOp op;
  const Tensor input = Tensor::from<float>({static_cast<std::int64_t>(x.size())}, std::span<const float>(x));
  return check_kernel(TestKernel(body, factor, domain), ops::make_task(op, std::array{input}), true);
}

void right(std::span<const float> x, std::span<float> y, std::span<std::byte> scratch) {
  std::fill(scratch.begin(), scratch.end(), std::byte{0});
  for (std::size_t i = 0; i < y.size(); ++i) y[i] = 2 * x[i];
}

const std::vector<float> kX = {1, -2, 0.5F, 0, 100, 3, 4};

}  // namespace

TEST_CASE("a kernel that is right passes with no error") {
  const KernelCheck result = check(kX, right);
  CHECK(result.passed());
  CHECK(result.verdict().empty());
  CHECK(result.kernel == "double.test.baseline");
  CHECK(result.error_reference == 0);
  CHECK(result.of_bound == 0);
}

TEST_CASE("an error is measured in units of the kernel's bound, and one over it fails") {
  // One unit in the last place of 2 is 2^-22 = 2u · |y|: twice the bound of a kernel with factor 1.
  const Body off = [](auto x, auto y, auto scratch) {
    right(x, y, scratch);
    y[0] = std::nextafter(y[0], kInf);
  };
  CHECK(check(kX, off, 1).of_bound == doctest::Approx(2).epsilon(1e-12));
  CHECK_FALSE(check(kX, off, 1).passed());
  CHECK(check(kX, off, 1).verdict() == "over its bound");
  CHECK(check(kX, off, 2).of_bound == doctest::Approx(1).epsilon(1e-12));
  CHECK(check(kX, off, 2).passed());
  CHECK(check(kX, off, 2).error_reference == doctest::Approx(0x1p-22 / 200));
}

TEST_CASE("an element left unwritten fails, even where the right result is NaN") {
  const Body lazy = [](auto x, auto y, auto scratch) { right(x, y.first(y.size() - 1), scratch); };
  for (const float last : {1.0F, kNan}) {
    const KernelCheck result = check({1, 2, last}, lazy);
    CHECK(result.unwritten == 1);
    CHECK(result.verdict() == "left 1 elements unwritten");
    CHECK_FALSE(result.passed());
  }
}

TEST_CASE("writing beside the output or the scratch memory fails") {
  const auto poke = [](float* at) { *at = 0; };
  CHECK(check(kX, [&](auto x, auto y, auto s) { right(x, y, s), poke(y.data() + y.size()); }).verdict() ==
        "wrote beside its memory");
  CHECK_FALSE(check(kX, [&](auto x, auto y, auto s) { right(x, y, s), poke(y.data() - 1); }).passed());
  CHECK_FALSE(
      check(kX, [](auto x, auto y, auto s) { right(x, y, s), s.data()[s.size()] = std::byte{1}; }).passed());
}

TEST_CASE("a result that depends on the number of threads or on uninitialised memory fails") {
  const Body threads = [](auto x, auto y, auto scratch) {
    right(x, y, scratch);
    if (thread_count() == 1) y[0] = std::nextafter(y[0], kInf);
  };
  CHECK(check(kX, threads, 100).verdict() == "depends on the number of threads");
  const Body reads = [](auto x, auto y, auto) {
    for (std::size_t i = 0; i < y.size(); ++i) y[i] += 2 * x[i];
  };
  CHECK_FALSE(check(kX, reads).passed());
}

TEST_CASE("an exception is a failure with its message") {
  const KernelCheck result = check(kX, [](auto, auto, auto) { throw std::runtime_error("no such luck"); });
  CHECK_FALSE(result.passed());
  CHECK(result.verdict() == "no such luck");
}

TEST_CASE("NaN and infinity must be where the definition has them") {
  CHECK(check({kNan, kInf, -kInf, 1}, right).passed());
  for (const std::size_t at : {0U, 1U, 2U, 3U}) {
    const Body wrong = [at](auto x, auto y, auto scratch) {
      right(x, y, scratch);
      y[at] = at == 0 || at == 3 ? kInf : kNan;
    };
    CHECK(std::isinf(check({kNan, kInf, -kInf, 1}, wrong, 1e6).of_bound));
  }
}

TEST_CASE("a result beyond float32 must be infinite") {
  CHECK(check({3e38F, 1}, right).passed());
  const Body saturates = [](auto x, auto y, auto scratch) {
    right(x, y, scratch);
    y[0] = std::numeric_limits<float>::max();
  };
  CHECK_FALSE(check({3e38F, 1}, saturates, 1e6).passed());
}

TEST_CASE("errors that are larger than the arithmetic predicts fail although each is within its bound") {
  const auto scaled = [](float by) {
    return [by](auto x, auto y, auto scratch) {
      right(x, y, scratch);
      for (float& v : y) v *= by;
    };
  };
  // Predicted: 0.4 u √100 = 4 u.
  const KernelCheck usual = check(kX, scaled(1 + 0x1p-22F), 100);
  CHECK(usual.passed());
  CHECK(usual.rms == doctest::Approx(0x1p-22).epsilon(1e-3));
  CHECK(usual.expected_rms == doctest::Approx(0x1p-22).epsilon(1e-12));
  const KernelCheck off = check(kX, scaled(1 + 0x1p-19F), 100);
  CHECK(off.of_bound < 0.5);
  CHECK_FALSE(off.passed());
  CHECK(off.verdict() == "within its bound, but less exact than its arithmetic");
}

TEST_CASE("outside a kernel's domain a result may be NaN or infinite, but no wrong number") {
  const Body overflows = [](auto x, auto y, auto scratch) {
    right(x, y, scratch);
    y[0] = kInf;
  };
  const Body wrong = [](auto x, auto y, auto scratch) {
    right(x, y, scratch);
    y[0] = 1;
  };
  const std::vector<float> x = {1e30F, 1};
  CHECK(check(x, overflows, 1, {.largest_input = 9e29}).outside == 1);
  CHECK(check(x, overflows, 1, {.largest_input = 9e29}).passed());
  CHECK(check(x, overflows, 1, {.largest_scale = 1.9e30}).passed());
  CHECK_FALSE(check(x, overflows, 1, {.largest_input = 1.1e30}).passed());
  CHECK_FALSE(check(x, overflows, 1, {.largest_scale = 2.1e30}).passed());
  CHECK_FALSE(check(x, wrong, 1, {.largest_input = 9e29}).passed());
}

TEST_CASE("denormal inputs are zero, and flushed results stay within the bound") {
  const KernelCheck result = check({1e-40F, 0x1p-126F, 1}, right);
  CHECK(result.passed());
  CHECK(result.output.data<float>()[0] == 0);
  const Body flushes = [](auto x, auto y, auto scratch) {
    right(x, y, scratch);
    y[0] = 0;  // instead of 2^-126 · 1.5
  };
  CHECK(check({0x1.8p-126F, 1}, flushes).of_bound == doctest::Approx(3).epsilon(1e-6));
}

TEST_CASE("relative errors are of the largest finite magnitude") {
  const float a[] = {1, 2, kInf, kNan};
  const float b[] = {1, 4, kInf, kNan};
  const float c[] = {1, 4, 5, kNan};
  const auto tensor = [](const float(&v)[4]) { return Tensor::from<float>({4}, std::span<const float>(v)); };
  CHECK(ops::relative_error(tensor(a), tensor(a)) == 0);
  CHECK(ops::relative_error(tensor(a), tensor(b)) == 0.5);
  CHECK(std::isinf(ops::relative_error(tensor(a), tensor(c))));
  CHECK(std::isinf(ops::relative_error(tensor(a), Tensor::zeros(DType::kF32, {3}))));
  CHECK(ops::relative_error(Tensor::zeros(DType::kF64, {4}), Tensor::zeros(DType::kF32, {4})) == 0);
}

namespace {

ops::OperatorCase relu_case(double expected) {
  ops::OperatorCase c;
  c.op = "relu";
  const double x[] = {-1, 0.1, 2};
  const double y[] = {0, 0.1, expected};
  c.inputs = {{"x", Tensor::from<double>({3}, std::span<const double>(x))}};
  c.expected = Tensor::from<double>({3}, std::span<const double>(y));
  return c;
}

}  // namespace

TEST_CASE("a case judges the definition on the inputs as given and kernels on rounded inputs") {
  const ops::CaseCheck result = ops::check_case(relu_case(2), detected_isa());
  CHECK(result.passed());
  CHECK(result.reference_error == 0);
  CHECK(result.of_tolerance == 0);
  REQUIRE_FALSE(result.kernels.empty());
  for (const KernelCheck& k : result.kernels) {
    CHECK(k.error_reference == 0);                                          // relu is exact
    CHECK(k.error_expected == doctest::Approx(std::fabs(0.1F - 0.1) / 2));  // but 0.1 is no float32
  }
}

TEST_CASE("a wrong expected output fails the definition, not the kernels") {
  const ops::CaseCheck result = ops::check_case(relu_case(2 + 1e-11), detected_isa());
  CHECK_FALSE(result.passed());
  CHECK_FALSE(result.reference_passed());
  for (const KernelCheck& k : result.kernels) CHECK(k.passed());
  // 2 · 16 · 2^-53 · |y| is 7e-15, and 2e-13 of the largest 4e-13.
  CHECK_FALSE(ops::check_case(relu_case(2 + 4.2e-13), Isa::kBaseline).reference_passed());
  CHECK(ops::check_case(relu_case(2 + 4e-13), Isa::kBaseline).reference_passed());
}

TEST_CASE("only kernels up to the level asked for are checked") {
  for (const Isa isa : available_isas())
    for (const KernelCheck& k : ops::check_case(relu_case(2), isa).kernels)
      CHECK((k.isa == isa || k.isa < isa || k.isa == Isa::kBaseline));
  for (const KernelCheck& k : ops::check_case(relu_case(2), Isa::kBaseline).kernels)
    CHECK(k.isa == Isa::kBaseline);
}

TEST_CASE("a bad file does not stop the others, and exit codes say what happened") {
  const TemporaryFolder folder;
  ops::write_case(folder.file("good.safetensors"), relu_case(2));
  const std::string good = folder.file("good.safetensors");
  const std::string missing = folder.file("missing.safetensors");
  CHECK(exit_code(ops::check_files({good}, detected_isa())) == 0);
  CHECK(exit_code(ops::check_files({missing, good}, detected_isa())) == 1);
  CHECK(exit_code(ops::check_files({missing}, detected_isa())) == 3);
  ops::write_case(folder.file("wrong.safetensors"), relu_case(3));
  std::ofstream(folder.file("junk.safetensors")) << "not a safetensors file";
  const std::vector<ops::CheckedFile> files = ops::check_files({folder.path().string()}, detected_isa());
  CHECK(exit_code(files) == 1);
  REQUIRE(files.size() == 3);
  CHECK(files[0].check->passed());
  CHECK(files[1].error.find("junk.safetensors") != std::string::npos);
  CHECK_FALSE(files[2].check->passed());
}

TEST_CASE("the table has a line for each kernel and the JSON the same numbers") {
  const TemporaryFolder folder;
  ops::write_case(folder.file("wrong.safetensors"), relu_case(3));
  const std::vector<ops::CheckedFile> files =
      ops::check_files({folder.file("wrong.safetensors"), folder.file("missing")}, detected_isa());
  const std::string table = ops::table_of(files);
  const std::size_t kernels = files[0].check->kernels.size();
  CHECK(static_cast<std::size_t>(std::count(table.begin(), table.end(), '\n')) == 5 + kernels);
  CHECK(table.find("FAILED: not the expected output") != std::string::npos);
  CHECK(table.find("1 file could not be checked") != std::string::npos);
  CHECK(table.find("1 case FAILED") != std::string::npos);

  const nlohmann::json json = nlohmann::json::parse(ops::json_of(files));
  CHECK(json["passed"] == false);
  REQUIRE(json["cases"].size() == 2);
  CHECK(json["cases"][0]["op"] == "relu");
  CHECK(json["cases"][0]["shape"] == nlohmann::json({3}));
  CHECK(json["cases"][0]["reference"]["error_vs_expected"].get<double>() == doctest::Approx(1.0 / 3));
  CHECK(json["cases"][0]["kernels"].size() == kernels);
  CHECK(json["cases"][1]["exit_code"] == 3);
}

TEST_CASE("the table says where terms cancel until nothing of the result is left") {
  // Neighbours' differences on 10^4: bfloat16 has 8 bits, so that 10^4 and 10^4 + 1 are the same.
  ops::OperatorCase c;
  c.op = "conv2d";
  c.attributes = "{}";
  std::vector<double> x(16 * 6, 1e4);
  for (std::size_t i = 0; i < x.size(); i += 2) x[i] += 1;
  std::vector<double> weight(16 * 2, 1.0 / 16);
  for (std::size_t i = 1; i < weight.size(); i += 2) weight[i] = -1.0 / 16;
  c.inputs = {{"x", Tensor::from<double>({1, 16, 1, 6}, std::span<const double>(x))},
              {"weight", Tensor::from<double>({1, 16, 1, 2}, std::span<const double>(weight))}};
  c.expected = Tensor::from<double>({1, 1, 1, 5}, std::vector<double>{1, -1, 1, -1, 1});
  const ops::CheckedFile file{"differences.safetensors", ops::check_case(c, Isa::kBaseline), "", {}};
  CHECK(file.check->passed());
  for (const KernelCheck& k : file.check->kernels)
    CHECK(k.result_lost() ==
          (k.kernel.find("bf16") != std::string::npos || k.kernel.find("int8") != std::string::npos));
  const std::string table = ops::table_of({file});
  CHECK(table.find("ok, but terms cancel until nothing of the result is left") != std::string::npos);
}
