#include "runtime/sensitivity.h"

#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "ops/conv2d/conv2d.h"
#include "ops/pointwise/pointwise.h"
#include "ops/pointwise/unary_op.h"
#include "runtime/error_model.h"
#include "runtime/fast_executor.h"
#include "runtime/plan.h"
#include "runtime/reference_executor.h"

using namespace slide;

namespace {

constexpr std::int64_t kChannels = 32;

Tensor filled(const Shape& shape, float value) {
  Tensor t(DType::kF32, shape);
  for (float& v : t.mutable_data<float>()) v = value;
  return t;
}

/// Numbers in [-1, 1] without a pattern, of mean zero as good as.
Tensor noise(const Shape& shape, std::uint32_t seed) {
  Tensor t(DType::kF32, shape);
  for (float& v : t.mutable_data<float>()) {
    seed = seed * 1664525U + 1013904223U;
    v = static_cast<float>(seed >> 8U) * 0x1p-23F - 1;
  }
  return t;
}

/// Every filter's nine weights of a channel add up to zero: eight noisy ones, and the middle minus their sum.
Tensor zero_sum(const Shape& shape) {
  Tensor t = noise(shape, 3);
  const std::span<float> w = t.mutable_data<float>();
  for (std::size_t k = 0; k < w.size(); k += 9) {
    w[k + 4] = 0;
    float sum = 0;
    for (std::size_t i = 0; i < 9; ++i) sum += w[k + i];
    w[k + 4] = -sum;
  }
  return t;
}

/// x -> a (3×3, bias `level`) -> b (3×3) -> c (3×3).
void build(Graph& g) {
  Value y = g.input("x", {1, kChannels, 16, 24});
  for (const std::string name : {"a", "b", "c"})
    y = ops::conv2d(y, g.parameter(name + ".weight", {kChannels, kChannels, 3, 3}),
                    g.parameter(name + ".bias", {kChannels}), {});
  g.output("y", y);
}

WeightMap weights(float level, bool cancelling) {
  const Shape filters{kChannels, kChannels, 3, 3};
  WeightMap map;
  map.set("a.weight", noise(filters, 1));
  map.set("a.bias", filled({kChannels}, level));
  map.set("b.weight", cancelling ? zero_sum(filters) : noise(filters, 2));
  map.set("b.bias", filled({kChannels}, 0));
  map.set("c.weight", noise(filters, 5));
  map.set("c.bias", filled({kChannels}, 0.5F));
  return map;
}

const PlanStep& step_of(const Plan& plan, const Graph& g, const std::string& weight) {
  for (const PlanStep& step : plan.steps)
    if (calibration_key(g, step.node) == weight) return step;
  throw std::runtime_error("no layer " + weight);
}

double sensitivity(const Tensor& weight, const Tensor& bias) {
  Graph g;
  const Shape& s = weight.shape();
  g.output("y",
           ops::conv2d(g.input("x", {1, s[1], 5, 5}), g.parameter("w", s), g.parameter("b", {s[0]}), {}));
  WeightMap map;
  map.set("w", weight);
  map.set("b", bias);
  std::vector<bool> constant(g.nodes().size());
  for (std::size_t i = 0; i < constant.size(); ++i) constant[i] = g.nodes()[i].kind == NodeKind::kParameter;
  return find_sensitivities(g, constant, map).back();
}

double rms(const Tensor& a, const Tensor& b) {
  const Tensor x = a.to(DType::kF64);
  double error = 0;
  double size = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(x.count()); ++i) {
    const double d = x.data<double>()[i] - b.data<double>()[i];
    error += d * d;
    size += b.data<double>()[i] * b.data<double>()[i];
  }
  return std::sqrt(error / size);
}

}  // namespace

// Of a standard normal variable: E[relu] = 1/√2π, E[relu²] = 1/2, and half of the slopes are 1.
TEST_CASE("a function's mean, variance and slope are those of its integrals") {
  using ops::FunctionStatistics;
  using ops::UnaryKind;
  const FunctionStatistics relu = ops::UnaryOp(UnaryKind::kRelu).statistics_at(0, 1);
  CHECK(relu.mean == doctest::Approx(0.3989).epsilon(0.03));
  CHECK(relu.variance == doctest::Approx(0.3408).epsilon(0.03));
  CHECK(relu.square_of_slope == doctest::Approx(0.5));
  const FunctionStatistics line = ops::UnaryOp(UnaryKind::kAffine, 2, -3).statistics_at(5, 4);
  CHECK(line.mean == doctest::Approx(7));
  CHECK(line.variance == doctest::Approx(16).epsilon(1e-3));
  CHECK(line.square_of_slope == doctest::Approx(4));
  const FunctionStatistics cut = ops::UnaryOp(UnaryKind::kRelu6).statistics_at(100, 4);
  CHECK(cut.mean == 6);
  CHECK(cut.variance == 0);
  CHECK(cut.square_of_slope == 0);
}

// n = 32 terms ±1 on a flat image of 1 round by √n, and what is left is the bias. On 0.5 ± 0.5 the terms'
// squares add up to n/2, the result's to n/4 and the bias'.
TEST_CASE("a filter is as sensitive as its sum is smaller than its terms") {
  Tensor pairs = filled({4, kChannels, 1, 1}, 1);
  for (std::size_t i = 0; i < 4 * kChannels; i += 2) pairs.mutable_data<float>()[i] = -1;
  CHECK(sensitivity(pairs, filled({4}, 4)) == doctest::Approx(std::sqrt(2.0)));
  CHECK(sensitivity(pairs, filled({4}, 0.125)) == doctest::Approx(std::sqrt(32.0) / 0.125));
  CHECK(sensitivity(pairs, filled({4}, 0)) == kMostSensitive);
  CHECK(sensitivity(filled({4, kChannels, 1, 1}, 1), filled({4}, 0)) == 1);
  // Nine weights of 1, six of -1: on a flat image 3 are left, whose rounding is common, of nine and six.
  Tensor partly = filled({1, 1, 3, 5}, 1);
  for (std::size_t i = 0; i < 6; ++i) partly.mutable_data<float>()[i] = -1;
  CHECK(sensitivity(partly, filled({1}, 0)) == doctest::Approx(std::sqrt((15.0 + 9.0) / 2 / 9)));
}

TEST_CASE("a layer whose sums cancel is planned in float32, one whose sums do not is not") {
  Graph g;
  build(g);
  for (const Precision precision : {Precision::kBf16, Precision::kInt8})
    for (const double budget : {0.0, 1e-1}) {
      CAPTURE(name_of(precision));
      CAPTURE(budget);
      const auto plan_with = [&](const WeightSource* source) {
        return make_plan(g, {.precision = precision,
                             .error_budget = budget,
                             .weights = source,
                             .only_precision = budget == 0});
      };
      const WeightMap cancelling = weights(1e4F, true);
      const WeightMap ordinary = weights(1e4F, false);
      const Plan bad = plan_with(&cancelling);
      const Plan good = plan_with(&ordinary);
      const PlanStep& cancels = step_of(bad, g, "b.weight");
      CHECK(cancels.kernel->precision() == Precision::kFp32);
      CHECK(cancels.sensitivity > 1000);
      CHECK(step_of(good, g, "b.weight").sensitivity < 4);
      // Plans with a budget take lower precisions only where they are faster.
      if (budget == 0 || runs_at(Isa::kAmx, active_isa())) {
        CHECK(step_of(good, g, "b.weight").kernel->precision() != Precision::kFp32);
        CHECK(step_of(plan_with(nullptr), g, "b.weight").kernel->precision() != Precision::kFp32);
      }
    }
}

TEST_CASE("a network with a layer whose sums cancel keeps its result in every precision") {
  Graph g;
  build(g);
  const WeightMap map = weights(1e4F, true);
  const NamedTensors inputs = {{"x", noise({1, kChannels, 16, 24}, 7)}};
  ReferenceExecutor reference(g, map);
  reference.run(inputs);
  for (const Precision precision : {Precision::kFp32, Precision::kBf16, Precision::kInt8}) {
    CAPTURE(name_of(precision));
    FastExecutor fast(g, map, {.precision = precision});
    fast.run(inputs);
    // Only the first layer rounds what the second one takes the differences of: 1e4 to 8 bits leaves steps of
    // 64, and they are the same at all pixels.
    CHECK(rms(fast.tensor("y"), reference.tensor("y")) < (precision == Precision::kFp32 ? 1e-3 : 0.05));
  }
}
