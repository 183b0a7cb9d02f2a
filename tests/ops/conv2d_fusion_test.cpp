#include <doctest/doctest.h>

#include "kernel_bounds.h"
#include "ops/conv2d/conv2d_op.h"
#include "ops/conv2d/gated_conv2d.h"
#include "ops/pointwise/pointwise.h"
#include "ops/resize/resize.h"
#include "ops/tensor_shape/tensor_shape.h"
#include "runtime/error.h"
#include "runtime/reference_executor.h"
#include "tests/quick.h"

using namespace slide;
using test::Call;
using test::random_tensor;

namespace {

/// A fused convolution with bias, and the same from its parts through the graph's public functions.
struct Pair {
  Call fused;
  Graph parts;
  NamedTensors inputs;

  Pair(const Shape& x, const Shape& weight, const ops::Conv2dParams& params, const ops::Conv2dFusion& fusion)
      : fused(tensors(x, weight, params, fusion), [&](const std::vector<Value>& v) {
          return v[0].graph().add(std::make_shared<ops::Conv2dOp>(params, fusion), v);
        }) {
    std::vector<Value> v;
    for (std::size_t i = 0; i < fused.inputs.size(); ++i) {
      v.push_back(parts.input("x" + std::to_string(i), fused.inputs[i].shape()));
      inputs.emplace("x" + std::to_string(i), fused.inputs[i]);
    }
    Value y = v[0];
    if (fusion.upsample_input == ops::Upsampling::kNearest) y = ops::upsample_nearest(y, 2);
    if (fusion.upsample_input == ops::Upsampling::kBilinear)
      y = ops::resize_bilinear(y, 2 * x[2], 2 * x[3], false);
    if (fusion.joined > 0) y = ops::concat({y, v.back()}, 1);
    if (fusion.relu_input) y = ops::relu(y);
    y = fusion.gate ? ops::gated_conv2d(y, v[1], v[2], params) : ops::conv2d(y, v[1], v[2], params);
    if (fusion.residual && !fusion.residual_last) y = ops::add(y, v[3]);
    if (fusion.activation) y = parts.add(fusion.activation, {y});
    if (fusion.residual && fusion.residual_last) y = ops::add(y, v[3]);
    parts.output("y", y);
  }

  static std::vector<Tensor> tensors(const Shape& x, const Shape& weight, const ops::Conv2dParams& params,
                                     ops::Conv2dFusion fusion) {
    std::vector<Tensor> all = {random_tensor(x, 1), random_tensor(weight, 2, 0.2),
                               random_tensor({weight[0]}, 3)};
    std::vector<Shape> shapes = ops::shapes_of(all);
    if (fusion.joined > 0) shapes.push_back({x[0], fusion.joined, 2 * x[2], 2 * x[3]});
    if (fusion.residual) {
      fusion.residual = false;
      all.push_back(random_tensor(ops::Conv2dOp(params, fusion).infer(shapes), 4));
    }
    if (fusion.joined > 0) all.push_back(random_tensor(shapes.back(), 5));
    return all;
  }

  void check() {
    ReferenceExecutor run(parts, WeightMap());
    run.run(inputs);
    const Tensor y = fused.reference();
    const std::span<const double> expected = run.tensor("y").data<double>();
    for (std::size_t i = 0; i < expected.size(); ++i)
      REQUIRE(y.data<double>()[i] == doctest::Approx(expected[i]).epsilon(1e-13));
    CHECK(test::check_kernels(fused) >= 2);
  }
};

std::shared_ptr<const ops::UnaryOp> unary(ops::UnaryKind kind, double a = 0, double b = 0) {
  return std::make_shared<ops::UnaryOp>(kind, a, b);
}

}  // namespace

TEST_CASE("a fused convolution is the composition of its parts, and its kernels keep their bounds") {
  const ops::Conv2dParams same = ops::Conv2dParams::same(3);
  for (const bool relu : {false, true})
    for (const bool residual : {false, true}) {
      CAPTURE(relu);
      CAPTURE(residual);
      const Shape x{1, 24, 13, 50};
      Pair(x, {20, 24, 3, 3}, same, {.relu_input = relu, .residual = residual}).check();
      Pair(x, {20, 24, 1, 1}, {},
           {.relu_input = relu, .residual = residual, .activation = unary(ops::UnaryKind::kRelu6)})
          .check();
      Pair(x, {24, 1, 3, 3}, ops::Conv2dParams::same(3, 2, 1, 24),
           {.relu_input = relu, .residual = residual, .activation = unary(ops::UnaryKind::kLeakyRelu, 0.1)})
          .check();
      Pair({1, 24, 14, 12}, {24, 1, 3, 3}, ops::Conv2dParams::same(3, 2, 1, 24),
           {.relu_input = relu, .residual = residual, .activation = unary(ops::UnaryKind::kRelu6)})
          .check();
      Pair(x, {4, 24, 3, 3}, same,
           {.relu_input = relu, .residual = residual, .activation = unary(ops::UnaryKind::kTanh)})
          .check();
      Pair(x, {1, 24, 1, 1}, {},
           {.relu_input = relu, .residual = residual, .activation = unary(ops::UnaryKind::kRelu)})
          .check();
      Pair(x, {40, 24, 3, 3}, ops::Conv2dParams::same(3, 2),
           {.relu_input = relu, .residual = residual, .gate = true})
          .check();
      Pair(x, {32, 6, 3, 3}, ops::Conv2dParams::same(3, 1, 1, 4),
           {.relu_input = relu,
            .residual = residual,
            .gate = true,
            .activation = unary(ops::UnaryKind::kTanh)})
          .check();
      Pair(x, {40, 24, 3, 3}, ops::Conv2dParams::same(3, 1, 4),
           {.relu_input = relu, .residual = residual, .activation = unary(ops::UnaryKind::kSigmoid)})
          .check();
    }
}

TEST_CASE("a residual may come behind the activation") {
  const Shape x{1, 24, 26, 50};
  for (const ops::UnaryKind kind : {ops::UnaryKind::kRelu, ops::UnaryKind::kSigmoid}) {
    const ops::Conv2dFusion fusion{.residual = true, .residual_last = true, .activation = unary(kind)};
    Pair(x, {20, 24, 3, 3}, ops::Conv2dParams::same(3), fusion).check();
    Pair(x, {20, 24, 3, 3}, ops::Conv2dParams::same(3, 1, 2), fusion).check();
    Pair(x, {20, 24, 3, 3}, ops::Conv2dParams::same(3, 2), fusion).check();
    Pair(x, {20, 24, 1, 1}, {}, fusion).check();
    Pair(x, {24, 1, 3, 3}, ops::Conv2dParams::same(3, 1, 1, 24), fusion).check();
    Pair(x, {1, 24, 3, 3}, ops::Conv2dParams::same(3), fusion).check();
    Pair(x, {3, 24, 1, 1}, {}, fusion).check();
  }
}

TEST_CASE("a convolution of an upsampled image is computed from the small image") {
  const ops::Conv2dParams same = ops::Conv2dParams::same(3);
  for (const auto& [height, width] : {std::pair{1, 1}, {2, 3}, {7, 30}, {24, 24}}) {
    if (test::quick() && height == 24) continue;
    const Shape x{1, 20, height, width};
    Pair(x, {18, 20, 3, 3}, same, {.upsample_input = ops::Upsampling::kNearest}).check();
    Pair(x, {24, 20, 3, 3}, same, {.upsample_input = ops::Upsampling::kNearest, .gate = true}).check();
    Pair(x, {18, 20, 3, 3}, same,
         {.relu_input = true,
          .upsample_input = ops::Upsampling::kNearest,
          .residual = true,
          .activation = unary(ops::UnaryKind::kRelu)})
        .check();
  }
  if (test::quick()) return;
  // Lines of tiles of Winograd that are cut into segments, which begin between two equal columns.
  Pair({1, 40, 16, 200}, {32, 40, 3, 3}, same,
       {.relu_input = true, .upsample_input = ops::Upsampling::kNearest})
      .check();
}

TEST_CASE("a convolution of a bilinearly upsampled image is computed from the small image") {
  const ops::Conv2dParams same = ops::Conv2dParams::same(3);
  constexpr auto kBilinear = ops::Upsampling::kBilinear;
  for (const auto& [height, width] : {std::pair{5, 6}, {7, 30}, {24, 24}, {4, 1}, {1, 33}}) {
    if (test::quick() && height == 24) continue;
    const Shape x{2, 20, 2 * height, 2 * width};
    Pair(x, {18, 20, 3, 3}, same, {.upsample_input = kBilinear}).check();
    Pair(x, {24, 20, 3, 3}, same, {.upsample_input = kBilinear, .gate = true}).check();
    Pair({1, 40, 2 * height, 2 * width + 1}, {36, 40, 3, 3}, same,
         {.upsample_input = kBilinear, .residual = true, .activation = unary(ops::UnaryKind::kRelu)})
        .check();
  }
  if (test::quick()) return;
  // Lines of tiles that are cut into segments, which begin between two columns of one.
  Pair({1, 40, 16, 200}, {32, 40, 3, 3}, same, {.upsample_input = kBilinear}).check();
}

TEST_CASE(
    "a convolution of a bilinearly upsampled image and joined channels computes both from where they lie") {
  const ops::Conv2dParams same = ops::Conv2dParams::same(3);
  constexpr auto kBilinear = ops::Upsampling::kBilinear;
  const Shape x{2, 20, 24, 22};
  Pair(x, {32, 48, 3, 3}, same, {.upsample_input = kBilinear, .joined = 28}).check();
  Pair(x, {40, 33, 3, 3}, same, {.upsample_input = kBilinear, .joined = 13, .gate = true}).check();
  Pair(x, {32, 48, 3, 3}, same,
       {.upsample_input = kBilinear,
        .joined = 28,
        .residual = true,
        .residual_last = true,
        .activation = unary(ops::UnaryKind::kRelu)})
      .check();
  if (test::quick()) return;
  Pair({1, 8, 16, 200}, {36, 40, 3, 3}, same, {.upsample_input = kBilinear, .joined = 32}).check();
}

TEST_CASE("joined channels must have the upsampled image's size") {
  Graph g;
  const Value x = g.input("x", {1, 20, 24, 22});
  const Value weight = g.input("w", {32, 48, 3, 3});
  const Value bias = g.input("b", {32});
  const auto op = std::make_shared<ops::Conv2dOp>(
      ops::Conv2dParams::same(3),
      ops::Conv2dFusion{.upsample_input = ops::Upsampling::kBilinear, .joined = 28});
  CHECK(g.add(op, {x, weight, bias, g.input("j", {1, 28, 48, 44})}).shape() == Shape{1, 32, 48, 44});
  CHECK_THROWS_AS(g.add(op, {x, weight, bias, g.input("k", {1, 28, 48, 43})}), Error);
  CHECK_THROWS_AS(g.add(op, {x, weight, bias, g.input("l", {1, 27, 48, 44})}), Error);
  CHECK_THROWS_AS(g.add(op, {x, weight, bias}), Error);
}

TEST_CASE("a residual must have the output's shape") {
  Graph g;
  const Value x = g.input("x", {1, 4, 8, 8});
  const Value weight = g.input("w", {6, 4, 1, 1});
  const Value bias = g.input("b", {6});
  const auto op = std::make_shared<ops::Conv2dOp>(ops::Conv2dParams{}, ops::Conv2dFusion{.residual = true});
  CHECK_THROWS_AS(g.add(op, {x, weight, bias, x}), Error);
  CHECK_THROWS_AS(g.add(op, {x, weight, bias}), Error);
}
