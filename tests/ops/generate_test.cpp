#include "ops/generate/generate.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "ops/case_file.h"
#include "ops/check.h"
#include "ops/judge.h"
#include "runtime/cpu.h"
#include "runtime/error.h"
#include "runtime/safetensors.h"
#include "tests/temporary_folder.h"

using namespace slide;
using ops::OperatorCase;
using ops::Trial;

namespace {

/// Of the first case of that trial that an operator gets with a seed.
OperatorCase case_of_trial(const std::string& op, Trial trial, std::uint64_t seed = 1) {
  return ops::generate_case(op, seed, static_cast<std::uint64_t>(trial));
}

bool same(const Tensor& a, const Tensor& b) {
  return a.shape() == b.shape() && std::ranges::equal(a.raw(), b.raw());
}

std::vector<std::byte> first_input(const OperatorCase& c) {
  const auto raw = c.inputs.at(0).second.raw();
  return {raw.begin(), raw.end()};
}

/// The answer as an operator in float32 that makes no error but the last would give it.
Tensor rounded_answer(const OperatorCase& c) { return ops::values_of(c, true).y64.to(DType::kF32).clone(); }

ErrorKind kind_of_failure(const auto& action) {
  try {
    action();
  } catch (const Error& e) {
    return e.kind();
  }
  FAIL("no error");
  return ErrorKind::kInternal;
}

}  // namespace

TEST_CASE("every kernel of every operator passes what is generated, and so does the rounded answer") {
  for (const std::string& op : ops::case_operators()) {
    std::size_t kernels = 0;
    for (std::uint64_t i = 0; i < ops::kTrials; ++i) {
      const OperatorCase c = ops::generate_case(op, 1, i);
      CAPTURE(c.source);
      CHECK(c.op == op);
      CHECK(c.scale.shape() == c.expected.shape());
      const ops::CaseCheck check = ops::check_case(c, detected_isa());
      CHECK(check.of_tolerance == 0);  // it is the definition's own answer
      for (const ops::KernelCheck& k : check.kernels) {
        INFO(k.kernel, ": ", k.verdict(), ", ", k.of_bound, " of its bound, rms ", k.rms, ", expected ",
             k.expected_rms);
        CHECK(k.passed());
      }
      kernels += check.kernels.size();
      const ops::Judgement judgement = ops::judge(c, rounded_answer(c), ops::Unit::kFp32);
      INFO(ops::text_of(judgement));
      CHECK(judgement.passed());
    }
    CHECK(kernels >= ops::kTrials);
  }
}

TEST_CASE("a generated case depends on operator, seed and index alone") {
  for (const std::string op : {"conv2d", "softmax", "attention"}) {
    const OperatorCase c = ops::generate_case(op, 7, 5);
    const OperatorCase again = ops::generate_case(op, 7, 5);
    CHECK(again.attributes == c.attributes);
    CHECK(same(again.inputs.at(0).second, c.inputs.at(0).second));
    CHECK(same(again.expected, c.expected));
    CHECK(first_input(ops::generate_case(op, 8, 5)) != first_input(c));
    CHECK(first_input(ops::generate_case(op, 7, 13)) != first_input(c));
  }
  CHECK(first_input(ops::generate_case("relu", 1, 0)) != first_input(ops::generate_case("relu6", 1, 0)));
  CHECK(kind_of_failure([] { static_cast<void>(ops::generate_case("no_such", 1, 0)); }) == ErrorKind::kUsage);
}

TEST_CASE("trials are what they are called") {
  for (std::uint64_t seed = 1; seed < 6; ++seed) {
    CAPTURE(seed);
    const auto count = [&](const std::string& op, Trial trial, const auto& holds) {
      const OperatorCase c = case_of_trial(op, trial, seed);
      return std::ranges::count_if(c.inputs.at(0).second.data<float>(), holds);
    };
    CHECK(count("relu", Trial::kSpecials, [](float v) { return !std::isfinite(v); }) >= 1);
    CHECK(count("conv2d", Trial::kSpecials, [](float v) { return !std::isfinite(v); }) >= 1);
    CHECK(count("add", Trial::kDenormal, [](float v) { return std::fabs(v) >= 0x1p-119F; }) == 0);
    CHECK(count("relu", Trial::kRange, [](float v) { return std::fabs(v) < 0x1p-121F || v > 0x1p121F; }) ==
          0);
    CHECK(count("relu", Trial::kIntegers, [](float v) { return v != std::nearbyint(v); }) == 0);
    CHECK(count("group_norm", Trial::kLargeMean, [](float v) { return std::fabs(v - 1e4F) > 7; }) == 0);
    const OperatorCase constant = case_of_trial("group_norm", Trial::kConstant, seed);
    CHECK(std::ranges::count(constant.inputs.at(0).second.data<float>(), 1.0F / 3) ==
          constant.inputs.at(0).second.count());
  }
  // Denormals, where taking them for zero changes little; the ends of the range; sums that cancel.
  const OperatorCase tiny = case_of_trial("abs", Trial::kDenormal);
  CHECK(std::ranges::any_of(tiny.inputs.at(0).second.data<float>(),
                            [](float v) { return std::fpclassify(v) == FP_SUBNORMAL; }));
  const OperatorCase root = case_of_trial("sqrt", Trial::kDenormal);  // √(2^-140) is no small error
  CHECK(std::ranges::none_of(root.inputs.at(0).second.data<float>(),
                             [](float v) { return std::fpclassify(v) == FP_SUBNORMAL; }));
  const OperatorCase wide = case_of_trial("mul", Trial::kRange);
  const auto values = wide.inputs.at(0).second.data<float>();
  CHECK(std::ranges::any_of(values, [](float v) { return std::fabs(v) > 0x1p30F; }));
  CHECK(std::ranges::any_of(values, [](float v) { return std::fabs(v) < 0x1p-30F; }));
  std::int64_t cancelled = 0, all = 0;
  for (std::uint64_t seed = 1; seed < 9; ++seed) {
    const OperatorCase c = case_of_trial("conv2d", Trial::kCancelling, seed);
    for (std::size_t i = 0; i < static_cast<std::size_t>(c.expected.count()); ++i, ++all)
      cancelled += std::fabs(c.expected.data<double>()[i]) < c.scale.data<double>()[i] / 100 ? 1 : 0;
  }
  CHECK(5 * cancelled > all);
}

TEST_CASE("shapes reach vector tails and every form of a convolution") {
  std::set<std::int64_t> tails, groups, strides, dilations, kernels;
  bool depthwise = false, uneven = false, bias = false, no_bias = false, batch = false;
  for (std::uint64_t i = 0; i < 128; ++i) {
    const OperatorCase c = ops::generate_case("conv2d", 1, i);
    const auto a = nlohmann::json::parse(c.attributes);
    const Shape& x = c.inputs.at(0).second.shape();
    const Shape& weight = c.inputs.at(1).second.shape();
    tails.insert(c.expected.shape()[3] % 16);
    groups.insert(a["groups"].get<std::int64_t>());
    strides.insert(a["stride"][1].get<std::int64_t>());
    dilations.insert(a["dilation"][1].get<std::int64_t>());
    kernels.insert(weight[3]);
    depthwise = depthwise || (x[1] > 1 && a["groups"] == x[1]);
    uneven = uneven || a["padding"][1] != a["padding"][3];
    (c.inputs.size() == 3 ? bias : no_bias) = true;
    batch = batch || x[0] > 1;
  }
  CHECK(tails.size() >= 12);
  CHECK(groups.size() >= 5);
  CHECK(strides.size() >= 3);
  CHECK(dilations.size() >= 3);
  for (const std::int64_t side : {1, 3, 5, 7}) CHECK(kernels.contains(side));
  for (const bool seen : {depthwise, uneven, bias, no_bias, batch}) CHECK(seen);
}

TEST_CASE("a wrong operator is caught by what is generated for it") {
  // Each mistake by the trial that is made for it; the rounded answer passes all (above).
  const auto judged = [](const OperatorCase& c, const auto& mistake) {
    Tensor y = rounded_answer(c);
    mistake(y.mutable_data<float>());
    return ops::judge(c, y, ops::Unit::kFp32).passed();
  };
  CHECK_FALSE(judged(case_of_trial("relu", Trial::kSpecials), [](std::span<float> y) {
    for (float& v : y) v = std::isnan(v) ? 0 : v;  // max(0, x) with the wrong operand first
  }));
  CHECK_FALSE(judged(case_of_trial("sigmoid", Trial::kRange), [](std::span<float> y) {
    for (float& v : y) v = v < 1e-30F ? std::numeric_limits<float>::quiet_NaN() : v;  // exp(x) / (1 + exp(x))
  }));
  CHECK_FALSE(judged(case_of_trial("conv2d", Trial::kRandom),
                     [](std::span<float> y) { y.back() = 0; }));  // the tail of a vector
  CHECK_FALSE(
      judged(case_of_trial("conv2d", Trial::kIntegers), [](std::span<float> y) { y.front() += 0.01F; }));
}

TEST_CASE("a folder of generated cases is all that a kernel writer needs, and replaces only itself") {
  const TemporaryFolder folder;
  const std::string cases = folder.file("a/b");
  CHECK(ops::generate_files("elu", 3, 9, cases, false) == 9);
  const std::vector<std::string> files = ops::case_files(cases);
  REQUIRE(files.size() == 9);
  CHECK(files[4].ends_with("/elu_3_0004_cancelling.safetensors"));
  const SafetensorsFile file = SafetensorsFile::open(files[4]);
  CHECK(file.metadata().at("op") == "elu");
  CHECK(file.metadata().at("source") == "slide_check generate elu --seed 3, case 4: cancelling");
  CHECK(file.info("x").dtype == DType::kF32);
  CHECK(file.info("expected").dtype == DType::kF64);
  CHECK(same(file.tensor("scale"), ops::generate_case("elu", 3, 4).scale));
  CHECK(ops::read_case(files[4]).inputs.size() == 1);  // the scale is no input

  CHECK(ops::generate_files("elu", 3, 9, cases, false) == 9);
  std::ofstream(files[8]) << "mine";
  std::filesystem::remove(files[0]);
  CHECK(kind_of_failure([&] { ops::generate_files("elu", 3, 9, cases, false); }) == ErrorKind::kUsage);
  CHECK_FALSE(std::filesystem::exists(files[0]));  // nothing was written
  CHECK(bytes_of_file(files[8]).size() == 4);
  CHECK(ops::generate_files("elu", 3, 9, cases, true) == 9);
  CHECK(kind_of_failure([&] { ops::generate_files("no_such", 3, 9, cases, true); }) == ErrorKind::kUsage);
  CHECK(kind_of_failure([&] { ops::generate_files("elu", 3, 1, files[1], true); }) == ErrorKind::kOutput);
}
