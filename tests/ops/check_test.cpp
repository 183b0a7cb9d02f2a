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
  // 16 · 2^-53 · |y| for the definition, as much for the program that gave the expected output.
  CHECK_FALSE(ops::check_case(relu_case(2 + 34 * 0x1p-52), Isa::kBaseline).reference_passed());
  CHECK(ops::check_case(relu_case(2 + 32 * 0x1p-52), Isa::kBaseline).reference_passed());
}

namespace {

/// The case of a call with some expected output, stored in float32 or in float64.
template <typename T>
ops::OperatorCase case_with(const std::string& op, const std::string& attributes,
                            const std::vector<std::pair<std::string, Tensor>>& inputs, const Shape& shape,
                            const std::vector<T>& expected) {
  return {op, attributes, "", inputs, Tensor::from<T>(shape, std::span<const T>(expected))};
}

template <typename T>
Tensor row(const std::vector<T>& values) {
  return Tensor::from<T>({static_cast<std::int64_t>(values.size())}, std::span<const T>(values));
}

bool definition_agrees(const ops::OperatorCase& c) {
  return ops::check_case(c, Isa::kBaseline).reference_passed();
}

}  // namespace

TEST_CASE("an expected output is held to the definition in every element, however large another one is") {
  // One channel is 1e7 times as large as the other, which is a tenth too large.
  for (const float off : {1.0F, 1.0001F, 1.1F}) {
    const Tensor x = Tensor::from<float>({1, 2, 1, 2}, std::vector<float>{1e7F, -3e7F, 1, 2});
    const Tensor w = Tensor::from<float>({2, 1, 1, 1}, std::vector<float>{1, 0.5F});
    const std::vector<float> y = {1e7F, -3e7F, 0.5F * off, 1 * off};
    const ops::OperatorCase c =
        case_with("conv2d", R"({"groups": 2})", {{"x", x}, {"weight", w}}, Shape{1, 2, 1, 2}, y);
    CHECK(definition_agrees(c) == (off == 1));
  }
}

TEST_CASE("a float32 sum in the order of its terms is a right expected output") {
  const int terms = 4608;
  std::vector<float> x, w;
  float sum = 0;
  for (int i = 0; i < terms; ++i) {
    x.push_back(0.5F + static_cast<float>(i % 37) / 37);
    w.push_back(0.25F + static_cast<float>(i % 101) / 101);
    sum += x.back() * w.back();
  }
  const auto with = [&](float y) {
    const Shape shape{1, terms, 1, 1};
    return case_with("conv2d", "{}",
                     {{"x", Tensor::from<float>(shape, std::span<const float>(x))},
                      {"weight", Tensor::from<float>(shape, std::span<const float>(w))}},
                     Shape{1, 1, 1, 1}, std::vector<float>{y});
  };
  CHECK(definition_agrees(with(sum)));
  CHECK(definition_agrees(with(sum * (1 + 1e-5F))));  // what the order of the sum may cost: 2.7e-4
  CHECK_FALSE(definition_agrees(with(sum * (1 + 4e-4F))));
}

TEST_CASE("an expected output may lose what its formula cancels, and no more") {
  // exp(x) - 1 in float32 is off by half a unit of exp(x), which is many units of a small result.
  const auto lost = [](float v) {
    return std::fabs(static_cast<double>(std::exp(v) - 1) - std::expm1(static_cast<double>(v)));
  };
  float x = -0.028F;
  for (int i = 1; i < 100; ++i)
    if (const float other = -0.028F - 1e-5F * static_cast<float>(i); lost(other) > lost(x)) x = other;
  const float y = std::exp(x) - 1;
  CHECK(lost(x) > 8 * 0x1p-24 * 0.028);
  const auto elu = [&](double by, double alpha) {
    return case_with("elu", R"({"alpha": )" + std::to_string(alpha) + "}", {{"x", row<float>({x})}}, Shape{1},
                     std::vector<float>{static_cast<float>(alpha) * (y + static_cast<float>(by))});
  };
  for (const double alpha : {0.125, 1.0, 1000.0}) {
    CHECK(definition_agrees(elu(0, alpha)));
    CHECK_FALSE(definition_agrees(elu(1e-4, alpha)));
  }
  // In float64 beside it: 2^-53 of 2, but not of the largest element.
  const auto elu64 = [&](double off) {
    return case_with("elu", "{}", {{"x", row<double>({-1e-9, 1e9})}}, Shape{2},
                     std::vector<double>{std::expm1(-1e-9) + off, 1e9});
  };
  CHECK(definition_agrees(elu64(16 * 0x1p-52)));
  CHECK_FALSE(definition_agrees(elu64(18 * 0x1p-52)));
  // 1 + erf(x/√2) is a unit of 1 at the least.
  const auto gelu = [&](double expected) {
    return case_with("gelu", "{}", {{"x", row<double>({-9})}}, Shape{1}, std::vector<double>{expected});
  };
  CHECK(definition_agrees(gelu(0)));
  CHECK_FALSE(definition_agrees(gelu(-2e-14)));
  // Mean 1e6, deviation 1: x/σ and mean/σ cancel. Not where the mean is 0.
  for (const double mean : {0.0, 1e6}) {
    const auto norm = [&](double off) {
      const double y1 = 1 / std::sqrt(1 + 1e-5);
      return case_with("layer_norm", R"({"axis": 0})",
                       {{"x", row<double>({mean - 1, mean + 1, mean - 1, mean + 1})},
                        {"weight", row<double>({1, 1, 1, 1})},
                        {"bias", row<double>({0, 0, 0, 0})}},
                       Shape{4}, std::vector<double>{-y1 + off, y1, -y1, y1});
    };
    CHECK(definition_agrees(norm(0)));
    CHECK(definition_agrees(norm(1e6 * 0x1p-53)) == (mean > 0));
    CHECK_FALSE(definition_agrees(norm(100 * 1e6 * 0x1p-53)));
  }
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
