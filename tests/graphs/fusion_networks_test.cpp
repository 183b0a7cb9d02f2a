#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "graphs/catalogue.h"
#include "graphs/formula_weights.h"
#include "ops/check.h"
#include "ops/fusion/fusion.h"
#include "runtime/fast_executor.h"
#include "runtime/reference_executor.h"
#include "tests/graphs/network_support.h"

using namespace slide;
using namespace slide::graphs;

namespace {

/// Of the float32 plan's outputs; as in golden_test.cpp.
constexpr double kFastTolerance = 1e-4;

using Counts = std::map<std::string, int>;

/// The nodes that depend on an input.
std::vector<const Node*> computed_nodes(const Graph& graph) {
  std::vector<const Node*> nodes;
  std::vector<bool> constant;
  const auto is_constant = [&](int j) { return constant[static_cast<std::size_t>(j)]; };
  for (const Node& node : graph.nodes()) {
    constant.push_back(node.kind != NodeKind::kInput && std::ranges::all_of(node.inputs, is_constant));
    if (!constant.back() && node.kind == NodeKind::kOp) nodes.push_back(&node);
  }
  return nodes;
}

/// How many of them there are of each operator.
Counts counts(const Graph& graph) {
  Counts result;
  for (const Node* node : computed_nodes(graph)) ++result[std::string(node->op->type())];
  return result;
}

/// Waves of two lengths; masks are zeros and ones.
NamedTensors smooth_inputs(const Graph& graph) {
  NamedTensors inputs;
  for (const Node& node : graph.nodes()) {
    if (node.kind != NodeKind::kInput) continue;
    const bool mask = node.name == "mask" || node.name == "hole" || node.name == "two_chan_trimap";
    Tensor t(DType::kF64, node.shape);
    const std::span<double> v = t.mutable_data<double>();
    for (std::size_t i = 0; i < v.size(); ++i) {
      const auto column = static_cast<double>(static_cast<std::int64_t>(i) % node.shape[-1]);
      v[i] = 0.5 + 0.5 * std::sin(0.37 * column + 0.011 * static_cast<double>(i));
      if (mask) v[i] = std::round(v[i]);
    }
    inputs[node.name] = t;
  }
  return inputs;
}

/// The computed nodes of the fused graph that the original has too, and the outputs.
std::set<std::string> common_tensors(const Graph& fused, const Graph& original) {
  std::set<std::string> names;
  for (const Node* node : computed_nodes(fused))
    if (original.find(node->name)) names.insert(node->name);
  for (const auto& output : fused.outputs()) names.insert(output.first);
  return names;
}

/// What the fused network computes, after its tensors were compared in float64 with the network's own.
Counts counts_fused(const std::string& network, std::int64_t height, std::int64_t width) {
  const auto graph = build_model(network, {.height = height, .width = width});
  const auto fused = ops::fuse(*graph, {.need_kernels = false});
  const WeightMap weights = weights_in_memory(*graph, FormulaWeights::made_up());
  const NamedTensors inputs = smooth_inputs(*graph);
  const std::set<std::string> names = common_tensors(*fused, *graph);
  ReferenceExecutor expected(*graph, weights);
  ReferenceExecutor run(*fused, weights);
  expected.run(inputs, names);
  run.run(inputs, names);
  for (const auto& output : graph->outputs()) CHECK(max_abs(expected.tensor(output.first)) > 1e-3);
  CHECK(static_cast<int>(names.size()) >= counts(*fused).at("conv2d"));
  for (const std::string& name : names) {
    CAPTURE(name);
    CHECK(ops::relative_error(run.tensor(name), expected.tensor(name)) <= 1e-10);
  }
  const auto plan = ops::fuse(*graph);
  FastExecutor fast(*plan, weights);
  fast.run(inputs);
  for (const auto& output : graph->outputs())
    CHECK(ops::relative_error(fast.tensor(output.first), expected.tensor(output.first)) <= kFastTolerance);
  const Counts before = counts(*graph);
  Counts after = counts(*fused);
  for (const char* const convolution : {"conv2d", "gated_conv2d"})
    if (before.contains(convolution)) CHECK(after.at(convolution) == before.at(convolution));
  return after;
}

}  // namespace

// Rectified shortcuts are tensors of their own.
TEST_CASE("midas_v21 becomes its 125 convolutions, a pooling, the resizing and three rectifications" *
          doctest::skip(quick())) {
  CHECK(counts_fused("midas_v21", 32, 64) ==
        Counts{{"conv2d", 125}, {"max_pool2d", 1}, {"relu", 3}, {"resize", 4}});
}

TEST_CASE("midas_v21_small becomes its convolutions and the resizing") {
  CHECK(counts_fused("midas_v21_small", 32, 64) == Counts{{"conv2d", 97}, {"resize", 4}});
}

TEST_CASE("slide_depth and slide_matte become their convolutions and the resizing") {
  const Counts wanted{{"conv2d", 76}, {"resize", 3}};
  CHECK(counts_fused("slide_depth", 32, 64) == wanted);
  CHECK(counts_fused("slide_matte", 32, 64) == wanted);
}

// The sums are residuals behind an activation; side outputs that feed the fused map have a reader beside
// their sigmoid. Of 33 tensors that are enlarged to be concatenated, 15 are so exactly by two.
TEST_CASE("u2netp keeps no batch norm and no ReLU") {
  CHECK(counts_fused("u2netp", 40, 48) ==
        Counts{{"concat", 36}, {"conv2d", 119}, {"max_pool2d", 33}, {"resize", 23}, {"sigmoid", 6}});
}

// At this size nine resizings are from one pixel to one.
TEST_CASE("u2net keeps no batch norm and no ReLU" * doctest::skip(quick())) {
  CHECK(counts_fused("u2net", 8, 16) ==
        Counts{{"concat", 36}, {"conv2d", 119}, {"max_pool2d", 33}, {"resize", 14}, {"sigmoid", 6}});
}

TEST_CASE("inpaint_coarse upsamples in its gated convolutions and ends with the tanh in its last") {
  CHECK(counts_fused("inpaint_coarse", 8, 16) ==
        Counts{{"affine", 1}, {"concat", 1}, {"conv2d", 1}, {"gated_conv2d", 15}, {"mul", 1}});
}

TEST_CASE("inpaint_deepfill upsamples in its gated convolutions; the layer gated by a ReLU stays") {
  CHECK(counts_fused("inpaint_deepfill", 16, 24) == Counts{{"add", 1},
                                                           {"affine", 1},
                                                           {"concat", 2},
                                                           {"contextual_attention", 1},
                                                           {"conv2d", 3},
                                                           {"gated_conv2d", 39},
                                                           {"mul", 4},
                                                           {"relu", 1},
                                                           {"sigmoid", 1},
                                                           {"slice", 2}});
}

TEST_CASE("slide_inpaint keeps no ReLU, no resizing and no concatenation within its network") {
  const Counts after = counts_fused("slide_inpaint", 64, 64);
  CHECK(after.at("conv2d") == 13);
  CHECK(after.at("push_pull_fill") == 4);
  CHECK(after.at("concat") == 2);  // its input and the result
  CHECK_FALSE(after.contains("relu"));
  CHECK_FALSE(after.contains("resize"));
}

TEST_CASE("slide_rim keeps no ReLU, no resizing and no concatenation within its network") {
  const Counts after = counts_fused("slide_rim", 64, 64);
  CHECK(after.at("conv2d") == 13);
  CHECK(after.at("concat") == 1);  // its input
  CHECK(after.at("resize") == 4);  // colours nearby
  CHECK_FALSE(after.contains("relu"));
}

// Group norm depends on the image; what follows it is computed with it. The three sums are of the output.
TEST_CASE("fba keeps no activation beside its convolutions and group norms" * doctest::skip(quick())) {
  const Counts after = counts_fused("fba", 16, 24);
  CHECK(after.at("conv2d") == 64);
  CHECK(after.at("group_norm") == 61);
  CHECK(after.count("relu") == 0);
  CHECK(after.count("leaky_relu") == 0);
  CHECK(after.at("add") == 3);
}
