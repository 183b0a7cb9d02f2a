#include "ops/fusion/fusion.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "kernel_bounds.h"
#include "ops/check.h"
#include "ops/conv2d/conv2d_op.h"
#include "ops/conv2d/gated_conv2d.h"
#include "ops/normalise/normalise.h"
#include "ops/pointwise/pointwise.h"
#include "ops/resize/resize_op.h"
#include "ops/tensor_shape/tensor_shape.h"
#include "runtime/reference_executor.h"
#include "runtime/weights.h"

using namespace slide;
using namespace slide::ops;
using Types = std::vector<std::string>;

namespace {

/// Random values for the nodes of a kind; what is called var is positive.
NamedTensors random_values(const Graph& graph, NodeKind kind) {
  NamedTensors values;
  unsigned seed = 1;
  for (const Node& node : graph.nodes()) {
    if (node.kind != kind) continue;
    Tensor t = test::random_tensor(node.shape, seed++);
    if (node.name.ends_with("var"))
      for (double& v : t.mutable_data<double>()) v = 0.5 + v * v;
    values[node.name] = t;
  }
  return values;
}

/// The fused graph, after its nodes and outputs were compared in float64 with those of the same names.
std::unique_ptr<Graph> fused(const Graph& graph, const FusionOptions& options = {.need_kernels = false}) {
  auto result = fuse(graph, options);
  WeightMap weights;
  for (const auto& [name, value] : random_values(graph, NodeKind::kParameter)) weights.set(name, value);
  const NamedTensors inputs = random_values(graph, NodeKind::kInput);
  ReferenceExecutor expected(graph, weights);
  ReferenceExecutor run(*result, weights);
  expected.run(inputs, {}, true);
  run.run(inputs, {}, true);
  REQUIRE(result->outputs().size() == graph.outputs().size());
  for (std::size_t k = 0; k < graph.outputs().size(); ++k) {
    const std::string& name = graph.outputs()[k].first;
    CHECK(result->outputs()[k].first == name);
    CHECK(relative_error(run.tensor(name), expected.tensor(name)) <= 1e-12);
  }
  for (const auto& [name, node] : result->taps())
    CHECK(relative_error(run.tensor(node), expected.tensor(graph.taps().at(name))) <= 1e-12);
  for (const Node& node : result->nodes()) {
    if (node.kind != NodeKind::kOp || !graph.find(node.name)) continue;
    INFO(node.name);
    CHECK(relative_error(run.tensor(node.name), expected.tensor(node.name)) <= 1e-12);
  }
  return result;
}

/// The operators of nodes that are not constant, in order.
Types types(const Graph& graph) {
  Types result;
  std::vector<bool> constant;
  const auto is_constant = [&](int j) { return constant[static_cast<std::size_t>(j)]; };
  for (const Node& node : graph.nodes()) {
    constant.push_back(node.kind != NodeKind::kInput && std::ranges::all_of(node.inputs, is_constant));
    if (!constant.back() && node.kind == NodeKind::kOp) result.emplace_back(node.op->type());
  }
  return result;
}

/// The fusion of the convolution of that name.
const Conv2dFusion& fusion_of(const Graph& graph, std::string_view name) {
  return dynamic_cast<const Conv2dOp&>(*graph.node(*graph.find(name)).op).fusion();
}

/// A 1×4×6×8 image through convolutions of as many channels.
struct Net {
  Graph graph;
  Value x = graph.input("x", {1, 4, 6, 8});

  Value conv(Value in, std::string_view name, bool bias = true, std::int64_t kernel = 3,
             std::int64_t channels = 4) {
    const auto scope = graph.scope(name);
    const Value weight = graph.parameter("weight", {channels, in.shape()[1], kernel, kernel});
    std::optional<Value> b;
    if (bias) b = graph.parameter("bias", {channels});
    return conv2d(in, weight, b, Conv2dParams::same(kernel));
  }
  Value norm(Value in, std::string_view name) {
    const auto scope = graph.scope(name);
    const Shape channels{in.shape()[1]};
    const Value weight = graph.parameter("weight", channels);
    const Value bias = graph.parameter("bias", channels);
    const Value mean = graph.parameter("mean", channels);
    return batch_norm(in, weight, bias, mean, graph.parameter("var", channels), 1e-3);
  }
  Value gated(Value in, std::string_view name) {
    const auto scope = graph.scope(name);
    const Value weight = graph.parameter("weight", {8, in.shape()[1], 3, 3});
    return gated_conv2d(in, weight, graph.parameter("bias", {8}), Conv2dParams::same(3));
  }
};

}  // namespace

TEST_CASE("batch norm becomes part of the weights of a convolution with bias or without") {
  for (const bool bias : {false, true}) {
    Net n;
    n.graph.output("y", n.norm(n.conv(n.x, "a", bias), "bn"));
    CHECK(types(n.graph) == Types{"conv2d", "batch_norm"});
    CHECK(types(*fused(n.graph)) == Types{"conv2d"});
  }
}

TEST_CASE("batch norm becomes part of the weights of a depthwise convolution") {
  Net n;
  const Value weight = n.graph.parameter("weight", {4, 1, 3, 3});
  n.graph.output("y", n.norm(conv2d(n.x, weight, std::nullopt, Conv2dParams::same(3, 2, 1, 4)), "bn"));
  CHECK(types(*fused(n.graph)) == Types{"conv2d"});
}

TEST_CASE("an affine map behind a convolution becomes part of its weights, whatever its slope") {
  Net n;
  n.graph.output("y", affine(n.norm(affine(n.conv(n.x, "a", false), -3, 0.5), "bn"), 2, -1));
  CHECK(types(*fused(n.graph)) == Types{"conv2d"});
}

TEST_CASE("batch norm stays where it cannot become part of the weights") {
  SUBCASE("the convolution has another reader") {
    Net n;
    const Value y = n.conv(n.x, "a");
    const Value z = n.norm(y, "bn");
    n.graph.output("y", add(z, relu(y)));
    CHECK(types(*fused(n.graph)) == Types{"conv2d", "batch_norm", "relu", "add"});
  }
  SUBCASE("the convolution is an output") {
    Net n;
    const Value y = n.conv(n.x, "a");
    n.graph.output("conv", y);
    n.graph.output("y", n.norm(y, "bn"));
    CHECK(types(*fused(n.graph)) == Types{"conv2d", "batch_norm"});
  }
  SUBCASE("its statistics are computed") {
    Net n;
    const Value given = n.graph.input("given", {4});
    const Value y = n.conv(n.x, "a");
    n.graph.output("y", batch_norm(y, given, given, given, abs(given), 1));
    CHECK(types(*fused(n.graph)) == Types{"conv2d", "abs", "batch_norm"});
  }
  SUBCASE("the weight is computed") {
    Net n;
    const Value weight = relu(n.graph.input("weight", {4, 4, 3, 3}));
    n.graph.output("y", n.norm(conv2d(n.x, weight, std::nullopt, Conv2dParams::same(3)), "bn"));
    CHECK(types(*fused(n.graph)) == Types{"relu", "conv2d", "batch_norm"});
  }
  SUBCASE("an activation lies between") {
    Net n;
    n.graph.output("y", n.norm(relu(n.conv(n.x, "a")), "bn"));
    CHECK(types(*fused(n.graph)) == Types{"conv2d", "batch_norm"});
  }
  SUBCASE("the convolution is gated") {
    Net n;
    n.graph.output("y", n.norm(n.gated(n.x, "a"), "bn"));
    CHECK(types(*fused(n.graph)) == Types{"gated_conv2d", "batch_norm"});
  }
}

TEST_CASE("an activation joins the convolution before it, another function does not") {
  using Function = Value (*)(Value);
  const auto left = [](Function f) {
    Net n;
    n.graph.output("y", f(n.conv(n.x, "a")));
    return types(*fused(n.graph)).size() - 1;
  };
  const std::vector<Function> activations{[](Value v) { return relu(v); },
                                          [](Value v) { return relu6(v); },
                                          [](Value v) { return leaky_relu(v, 0.01); },
                                          [](Value v) { return elu(v); },
                                          [](Value v) { return sigmoid(v); },
                                          [](Value v) { return slide::ops::tanh(v); },
                                          [](Value v) { return clip(v, -0.5, 0.25); }};
  for (const Function f : activations) CHECK(left(f) == 0);
  const std::vector<Function> others{[](Value v) { return slide::ops::exp(v); },
                                     [](Value v) { return greater(v, 0); }};
  for (const Function f : others) CHECK(left(f) == 1);
  CHECK(left([](Value v) { return affine(relu(v), 2, 1); }) == 1);
  CHECK(left([](Value v) { return relu(affine(v, 2, 1)); }) == 0);
  CHECK(left([](Value v) { return slide::ops::tanh(sigmoid(v)); }) == 1);
}

TEST_CASE("a residual block becomes its convolutions") {
  Net n;
  const Value y = relu(n.norm(n.conv(n.x, "a", false), "bn1"));
  n.graph.output("y", relu(add(n.x, n.norm(n.conv(y, "b", false), "bn2"))));
  const auto result = fused(n.graph);
  CHECK(types(*result) == Types{"conv2d", "conv2d"});
  CHECK(fusion_of(*result, "y").residual);
  CHECK(fusion_of(*result, "y").activation->kind() == UnaryKind::kRelu);
}

TEST_CASE("a sum behind an activation becomes a residual behind it, and nothing follows") {
  Net n;
  n.graph.output("y", relu(add(relu(n.conv(n.x, "a")), n.x)));
  const auto result = fused(n.graph);
  CHECK(types(*result) == Types{"conv2d", "relu"});
  const auto& fusion = fusion_of(*result, result->node(result->node(*result->find("y")).inputs[0]).name);
  CHECK(fusion.residual);
  CHECK(fusion.residual_last);
  CHECK(fusion.activation->kind() == UnaryKind::kRelu);
}

TEST_CASE("a group norm takes in the sum and the activation behind it") {
  const auto group = [](Net& n, Value x, std::string_view name) {
    const auto scope = n.graph.scope(name);
    const Value weight = n.graph.parameter("weight", {4});
    return group_norm(x, 2, weight, n.graph.parameter("bias", {4}), 1e-3);
  };
  SUBCASE("both") {
    Net n;
    n.graph.output("y", leaky_relu(add(group(n, n.x, "a"), n.x), 0.1));
    CHECK(types(*fused(n.graph)) == Types{"group_norm"});
  }
  SUBCASE("of two added, the later one takes the other") {
    Net n;
    const Value a = group(n, n.x, "a");
    n.graph.output("y", relu(add(a, group(n, n.x, "b"))));
    const auto result = fused(n.graph);
    CHECK(types(*result) == Types{"group_norm", "group_norm"});
    CHECK(result->node(result->node(*result->find("y")).inputs[3]).name == "a.group_norm");
  }
  SUBCASE("an activation that others read, too, stays out of what is behind it") {
    Net n;
    const Value y = relu(group(n, n.x, "a"));
    n.graph.output("a", y);
    n.graph.output("y", add(y, n.x));
    CHECK(types(*fused(n.graph)) == Types{"group_norm", "add"});
  }
}

TEST_CASE("a convolution without bias that gets a residual gets a bias of zeros") {
  Net n;
  n.graph.output("y", add(n.conv(n.x, "a", false), n.x));
  const auto result = fused(n.graph);
  CHECK(types(*result) == Types{"conv2d"});
  CHECK(result->node(*result->find("y")).inputs.size() == 4);
}

TEST_CASE("of two convolutions added the later one takes the other in, either way round") {
  for (const bool swapped : {false, true}) {
    Net n;
    const Value a = n.conv(n.x, "a");
    const Value b = n.norm(n.conv(n.x, "b", false, 1), "bn");
    n.graph.output("y", swapped ? add(b, a) : add(a, b));
    const auto result = fused(n.graph);
    CHECK(types(*result) == Types{"conv2d", "conv2d"});
    const Node& node = result->node(*result->find("y"));
    CHECK(result->node(node.inputs[1]).shape[2] == 1);
    CHECK(result->node(node.inputs[3]).name == "a.conv2d");
  }
}

TEST_CASE("the earlier convolution takes the sum in where the later one is read by others too") {
  Net n;
  const Value a = n.conv(n.x, "a");
  const Value b = n.conv(n.x, "b");
  n.graph.output("b", b);
  n.graph.output("y", add(a, b));
  const auto result = fused(n.graph);
  CHECK(types(*result) == Types{"conv2d", "conv2d"});
  CHECK(fusion_of(*result, "y").residual);
  CHECK_FALSE(fusion_of(*result, "b").residual);
}

TEST_CASE("a sum stays where it is no residual") {
  SUBCASE("the other summand is broadcast") {
    Net n;
    n.graph.output("y", add(n.conv(n.x, "a"), n.graph.input("row", {1, 4, 1, 8})));
    CHECK(types(*fused(n.graph)) == Types{"conv2d", "add"});
  }
  SUBCASE("the convolution is broadcast") {
    Net n;
    n.graph.output("y", add(n.conv(n.x, "a", true, 3, 1), n.x));
    CHECK(types(*fused(n.graph)) == Types{"conv2d", "add"});
  }
  SUBCASE("the convolution is added to itself") {
    Net n;
    const Value y = n.conv(n.x, "a");
    n.graph.output("y", add(y, y));
    CHECK(types(*fused(n.graph)) == Types{"conv2d", "add"});
  }
  SUBCASE("there is one already") {
    Net n;
    const Value y = add(n.conv(n.x, "a"), n.x);
    n.graph.output("y", add(y, slide::ops::exp(n.x)));
    CHECK(types(*fused(n.graph)) == Types{"conv2d", "exp", "add"});
  }
  SUBCASE("a function that is no activation lies between") {
    Net n;
    n.graph.output("y", add(slide::ops::exp(n.conv(n.x, "a")), n.x));
    CHECK(types(*fused(n.graph)) == Types{"conv2d", "exp", "add"});
  }
  SUBCASE("the convolution is gated") {
    Net n;
    n.graph.output("y", add(n.gated(n.x, "a"), n.x));
    CHECK(types(*fused(n.graph)) == Types{"gated_conv2d", "add"});
  }
  SUBCASE("it is a difference") {
    Net n;
    n.graph.output("y", sub(n.conv(n.x, "a"), n.x));
    CHECK(types(*fused(n.graph)) == Types{"conv2d", "sub"});
  }
}

TEST_CASE("a ReLU that only convolutions read is done by each of them") {
  Net n;
  const Value r = relu(n.x);
  n.graph.output("y", n.conv(r, "a"));
  n.graph.output("z", n.gated(r, "b"));
  const auto result = fused(n.graph);
  CHECK(types(*result) == Types{"conv2d", "gated_conv2d"});
  CHECK(fusion_of(*result, "y").relu_input);
  CHECK(fusion_of(*result, "z").relu_input);
}

TEST_CASE("a pre-activation unit becomes two convolutions, the second with its input as residual") {
  Net n;
  const Value first = relu(n.x);
  const Value y = n.conv(relu(n.conv(first, "a")), "b");
  SUBCASE("as it was given") { n.graph.output("y", add(y, n.x)); }
  SUBCASE("rectified: the ReLU is a tensor of its own") { n.graph.output("y", add(y, first)); }
  const bool rectified = n.graph.node(n.graph.nodes().back().inputs[1]).name == "relu";
  const auto result = fused(n.graph);
  CHECK(types(*result) == (rectified ? Types{"relu", "conv2d", "conv2d"} : Types{"conv2d", "conv2d"}));
  CHECK(fusion_of(*result, "relu_2").relu_input != rectified);
}

TEST_CASE("a ReLU stays where something else than a convolution's image is made of it") {
  SUBCASE("a weight") {
    Net n;
    const Value r = relu(n.graph.input("w", {4, 4, 3, 3}));
    n.graph.output("y", conv2d(n.x, r, std::nullopt, Conv2dParams::same(3)));
    CHECK(types(*fused(n.graph)) == Types{"relu", "conv2d"});
  }
  SUBCASE("image and residual") {
    Net n;
    const Value r = relu(n.x);
    n.graph.output("y", add(n.conv(r, "a"), r));
    CHECK(types(*fused(n.graph)) == Types{"relu", "conv2d"});
  }
  SUBCASE("an output") {
    Net n;
    const Value r = relu(n.x);
    n.graph.output("r", r);
    n.graph.output("y", n.conv(r, "a"));
    CHECK(types(*fused(n.graph)) == Types{"relu", "conv2d"});
  }
  SUBCASE("it is a relu6") {
    Net n;
    n.graph.output("y", n.conv(relu6(n.x), "a"));
    CHECK(types(*fused(n.graph)) == Types{"relu6", "conv2d"});
  }
}

TEST_CASE("nearest upsampling by two is done by the 3x3 convolutions that read it") {
  Net n;
  const Value up = upsample_nearest(relu(n.x), 2);
  n.graph.output("y", n.conv(up, "a"));
  n.graph.output("z", n.gated(up, "b"));
  const auto result = fused(n.graph);
  CHECK(types(*result) == Types{"conv2d", "gated_conv2d"});
  for (const std::string name : {"y", "z"}) {
    CHECK(fusion_of(*result, name).upsample_input == ops::Upsampling::kNearest);
    CHECK(fusion_of(*result, name).relu_input);
  }
}

TEST_CASE("bilinear upsampling by two is done by the 3x3 convolutions that read it, where Winograd pays") {
  const auto types_of = [](std::int64_t channels, bool align_corners, bool relu_between) {
    Graph g;
    const Value x = g.input("x", {1, channels, 24, 20});
    Value up = resize_bilinear(x, 48, 40, align_corners);
    if (relu_between) up = relu(up);
    g.output("y",
             conv2d(up, g.parameter("w", {channels, channels, 3, 3}), std::nullopt, Conv2dParams::same(3)));
    return types(*fused(g, {}));
  };
  CHECK(types_of(24, false, false) == Types{"conv2d"});
  CHECK(types_of(24, false, true) == Types{"resize", "conv2d"});  // cut off below zero after it
  CHECK(types_of(24, true, false) == Types{"resize", "conv2d"});
  CHECK(types_of(8, false, false) == Types{"resize", "conv2d"});
}

TEST_CASE("a bilinearly upsampled tensor and one it is concatenated with are read where they are") {
  const auto types_of = [](std::int64_t up_channels, std::int64_t channels, bool bias, auto&& change) {
    Graph g;
    const Value x = g.input("x", {1, up_channels, 24, 22});
    const Value up = resize_bilinear(x, 48, 44, false);
    const Value joined = change(g, up, g.input("b", {1, channels, 48, 44}));
    const std::optional<Value> b = bias ? std::optional(g.parameter("bias", {32})) : std::nullopt;
    g.output("y", conv2d(joined, g.parameter("w", {32, joined.shape()[1], 3, 3}), b, Conv2dParams::same(3)));
    return types(*fused(g, {}));
  };
  const auto concat_of = [](Graph&, Value up, Value b) { return concat({up, b}, 1); };
  CHECK(types_of(24, 24, true, concat_of) == Types{"conv2d"});
  const Types apart = {"resize", "concat", "conv2d"};
  CHECK(types_of(25, 24, true, concat_of) == apart);  // a word would hold a channel of each
  CHECK(types_of(4, 8, true, concat_of) == apart);    // Winograd does not pay
  CHECK(types_of(24, 24, false, concat_of) == apart);
  CHECK(types_of(24, 24, true, [](Graph&, Value up, Value b) { return concat({b, up}, 1); }) == apart);
  CHECK(types_of(24, 24, true, [](Graph& g, Value up, Value b) {
          g.output("up", up);
          return concat({up, b}, 1);
        }) == apart);
  CHECK(types_of(24, 24, true, [](Graph& g, Value up, Value b) {
          const Value both = concat({up, b}, 1);
          g.output("both", both);
          return both;
        }) == apart);
}

TEST_CASE("below zero is cut off before bilinear upsampling by a node of its own") {
  Graph g;
  const Value x = g.input("x", {1, 24, 24, 20});
  g.output("y", conv2d(resize_bilinear(relu(x), 48, 40, false), g.parameter("w", {24, 24, 3, 3}),
                       std::nullopt, Conv2dParams::same(3)));
  CHECK(types(*fused(g)) == Types{"relu", "conv2d"});
}

TEST_CASE("upsampling to which something was added stays") {
  for (const bool bilinear : {false, true}) {
    Graph g;
    const Value x = g.input("x", {1, 24, 24, 20});
    const Value lateral = g.input("lateral", {1, 24, 48, 40});
    const Value up = bilinear ? resize_bilinear(x, 48, 40, false) : upsample_nearest(x, 2);
    g.output("y",
             conv2d(add(up, lateral), g.parameter("w", {24, 24, 3, 3}), std::nullopt, Conv2dParams::same(3)));
    CHECK(types(*fused(g)) == Types{"resize", "conv2d"});
  }
}

TEST_CASE("upsampling stays where it is not by two, not the nearest, or not read by same-size 3x3") {
  const auto left = [](auto&& build) {
    Net n;
    n.graph.output("y", build(n));
    return types(*fused(n.graph)) == Types{"resize", "conv2d"};
  };
  CHECK(left([](Net& n) { return n.conv(upsample_nearest(n.x, 3), "a"); }));
  CHECK(left([](Net& n) { return n.conv(resize_bilinear(n.x, 12, 16, true), "a"); }));
  CHECK(left([](Net& n) { return n.conv(upsample_nearest(n.x, 2), "a", true, 5); }));
  for (const Conv2dParams& params : {Conv2dParams::same(3, 2), Conv2dParams::same(3, 1, 2), Conv2dParams{}})
    CHECK(left([&](Net& n) {
      return conv2d(upsample_nearest(n.x, 2), n.graph.parameter("w", {4, 4, 3, 3}), std::nullopt, params);
    }));
  CHECK(left([](Net& n) {
    return conv2d(upsample_nearest(n.x, 2), n.graph.parameter("w", {4, 1, 3, 3}), std::nullopt,
                  Conv2dParams::same(3, 1, 1, 4));
  }));
  // ONNX's rounding up of i / 2 shifts the copies by a pixel.
  CHECK(left([](Net& n) {
    const ResizeParams up{.mode = ResizeMode::kNearest,
                          .coordinates = ResizeCoordinates::kAsymmetric,
                          .size = {12, 16},
                          .scale = {},
                          .nearest = NearestRounding::kCeil};
    return n.conv(resize(n.x, up), "a");
  }));
}

TEST_CASE("upsampling stays if one of its readers cannot do it") {
  Net n;
  const Value up = upsample_nearest(n.x, 2);
  n.graph.output("y", add(n.conv(up, "a"), up));
  n.graph.output("z", n.conv(up, "b", true, 1));
  CHECK(types(*fused(n.graph)) == Types{"resize", "conv2d", "conv2d"});
}

TEST_CASE("a 1x1 convolution comes before the enlargement that it reads, with what is fused behind it") {
  const auto enlarged = [](auto&& resized) {
    Net n;
    const Value y = n.norm(n.conv(resized(n.x), "a", false, 1, 3), "bn");
    n.graph.output("y", add(y, n.graph.input("z", y.shape())));
    const auto result = fused(n.graph);
    CHECK(types(*result) == Types{"conv2d", "resize"});
    const Node& outer = result->node(*result->find("y"));
    CHECK(dynamic_cast<const ResizeOp&>(*outer.op).fusion().residual);
    CHECK(result->node(outer.inputs[0]).shape == Shape{1, 3, 6, 8});
  };
  enlarged([](Value x) { return upsample_nearest(x, 3); });
  enlarged([](Value x) { return resize_bilinear(x, 12, 16, true); });
  enlarged([](Value x) { return resize_bilinear(x, 7, 8, false); });
  enlarged([](Value x) { return resize_bicubic(x, 11, 19); });
}

TEST_CASE("a 1x1 convolution stays behind a resize where it would not be the same or no less work") {
  const auto order = [](auto&& build) {
    Net n;
    n.graph.output("y", build(n));
    return types(*fused(n.graph));
  };
  const auto conv_of_larger = [](Net& n, const Conv2dParams& params) {
    const Value weight = n.graph.parameter("w", {4, 4, 1, 1});
    return conv2d(resize_bilinear(n.x, 12, 16, false), weight, std::nullopt, params);
  };
  CHECK(order([](Net& n) { return n.conv(resize_bilinear(n.x, 3, 4, false), "a", true, 1); }) ==
        Types{"resize", "conv2d"});
  CHECK(order([&](Net& n) { return conv_of_larger(n, {.stride = {2, 2}}); }) == Types{"resize", "conv2d"});
  CHECK(order([&](Net& n) {
          return conv_of_larger(n, {.padding = {0, 1, 0, 0}});
        }) == Types{"resize", "conv2d"});
  CHECK(order([&](Net& n) { return relu(conv_of_larger(n, {})); }) == Types{"resize", "conv2d"});
  CHECK(order([&](Net& n) {
          const Value larger = resize_bilinear(n.x, 12, 16, false);
          return concat(std::vector{larger, n.conv(larger, "a", true, 1)}, 1);
        }) == Types{"resize", "conv2d", "concat"});
}

TEST_CASE("a resize takes in the sum behind it unless a convolution does") {
  Net n;
  const Value larger = resize_bilinear(n.x, 12, 16, false);
  SUBCASE("of a tensor") {
    n.graph.output("y", relu(add(n.graph.input("z", larger.shape()), larger)));
    CHECK(types(*fused(n.graph)) == Types{"resize", "relu"});
  }
  SUBCASE("of a convolution, though that is the earlier one") {
    const Value y = n.conv(n.graph.input("z", larger.shape()), "a");
    n.graph.output("y", relu(add(y, resize_bilinear(n.x, 12, 16, true))));
    CHECK(types(*fused(n.graph)) == Types{"resize", "conv2d"});
  }
  SUBCASE("of itself, not") {
    n.graph.output("y", add(larger, larger));
    CHECK(types(*fused(n.graph)) == Types{"resize", "add"});
  }
}

TEST_CASE("zeros around an image become the padding of the convolutions that read it") {
  const auto padded = [](double value, PadMode mode) {
    Net n;
    n.graph.output("y", n.conv(pad(n.x, {0, 1, 2, 3}, mode, value), "a"));
    return types(*fused(n.graph));
  };
  CHECK(padded(0, PadMode::kConstant) == Types{"conv2d"});
  CHECK(padded(1, PadMode::kConstant) == Types{"pad", "conv2d"});
  CHECK(padded(0, PadMode::kEdge) == Types{"pad", "conv2d"});
  Net n;  // zeros before upsampling are twice as many behind it
  n.graph.output("y", n.conv(upsample_nearest(pad(n.x, {1, 1, 1, 1}, PadMode::kConstant), 2), "a"));
  CHECK(types(*fused(n.graph)) == Types{"pad", "conv2d"});
}

TEST_CASE("nodes that copy their input are left out, but for outputs") {
  Net n;
  Value y = affine(resize_bilinear(n.x, 6, 8, true), 1, 0);
  y = resize_bicubic(slice(concat({y}, 1), 2, 0, 6), 6, 8);
  n.graph.output("y", slide::ops::exp(reshape(y, {1, 4, 6, 8})));
  n.graph.output("x", affine(n.x, 1, 0));
  CHECK(types(*fused(n.graph)) == Types{"exp", "affine"});
}

TEST_CASE("nodes that look like copies and are none stay") {
  Net n;
  const ResizeParams shifted{.mode = ResizeMode::kNearest,
                             .coordinates = ResizeCoordinates::kAsymmetric,
                             .size = {6, 8},
                             .scale = {{2, 2}}};
  const Value y = concat({resize(n.x, shifted), slice(n.x, 2, 0, 3)}, 2);
  n.graph.output("y", slide::ops::exp(reshape(y, {1, 4, 72})));
  CHECK(types(*fused(n.graph)) == Types{"resize", "slice", "concat", "reshape", "exp"});
}

TEST_CASE("what no output depends on is left out, and is no reader; inputs and parameters stay") {
  Net n;
  const Value y = n.conv(n.x, "a");
  (void)slide::ops::exp(relu(y));
  (void)n.conv(y, "unread");
  (void)n.graph.input("unused", {2});
  n.graph.output("y", relu(y));
  const auto result = fused(n.graph);
  CHECK(types(*result) == Types{"conv2d"});
  std::vector<std::string> names;
  for (const Node& node : result->nodes()) names.push_back(node.name);
  CHECK(names == std::vector<std::string>{"x", "a.weight", "a.bias", "unread.weight", "unread.bias", "unused",
                                          "relu_2"});
}

TEST_CASE("taps stay where there is still such a tensor; on request nothing is fused across them") {
  Net n;
  const Value y = n.conv(n.x, "a");
  n.graph.tap("conv", y);
  const Value z = relu(y);
  n.graph.tap("rectified", z);
  n.graph.output("y", slide::ops::exp(z));
  const auto result = fused(n.graph);
  CHECK(types(*result) == Types{"conv2d", "exp"});
  CHECK_FALSE(result->taps().contains("conv"));
  CHECK(result->node(result->taps().at("rectified")).name == "relu");
  const auto kept = fused(n.graph, {.keep_taps = true, .need_kernels = false});
  CHECK(types(*kept) == Types{"conv2d", "relu", "exp"});
  CHECK(kept->taps().size() == 2);
}

TEST_CASE("fusing a fused graph changes nothing") {
  Net n;
  const Value up = upsample_nearest(relu(n.norm(n.conv(n.x, "a"), "bn")), 2);
  n.graph.output("y", relu(add(n.conv(up, "b"), up)));
  const auto once = fused(n.graph);
  const auto twice = fused(*once);
  REQUIRE(once->nodes().size() == twice->nodes().size());
  for (std::size_t i = 0; i < once->nodes().size(); ++i)
    CHECK(once->nodes()[i].name == twice->nodes()[i].name);
}
