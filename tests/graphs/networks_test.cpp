#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <string>
#include <vector>

#include "graphs/catalogue.h"
#include "graphs/depth_anything_v2.h"
#include "graphs/fba.h"
#include "graphs/formula_weights.h"
#include "graphs/inpaint_coarse.h"
#include "graphs/inpaint_deepfill.h"
#include "graphs/stages.h"
#include "runtime/reference_executor.h"
#include "tests/graphs/network_support.h"

using namespace slide;
using namespace slide::graphs;

namespace {

bool contains(const std::string& text, std::string_view part) { return text.find(part) != std::string::npos; }

ErrorKind kind_of(auto&& call) {
  try {
    call();
  } catch (const Error& e) {
    return e.kind();
  }
  return ErrorKind::kInternal;
}

/// Weights of which only the shapes matter.
WeightMap shapes_only(const std::vector<std::pair<std::string, Shape>>& tensors) {
  WeightMap weights("w.safetensors");
  for (const auto& [name, shape] : tensors) weights.set(name, Tensor::zeros(DType::kF32, shape));
  return weights;
}

WeightMap coarse_shapes(const Shape& first, const Shape& last) {
  return shapes_only({{"conv1.conv.weight", first}, {"conv16.conv.weight", last}});
}

/// Runs a small graph with made-up weights; all inputs are a ramp, the masks a block.
Tensor run_made_up(const Graph& graph, const WeightSource& weights) {
  NamedTensors inputs;
  for (const Node& node : graph.nodes()) {
    if (node.kind != NodeKind::kInput) continue;
    Tensor t(DType::kF32, node.shape);
    const std::span<float> x = t.mutable_data<float>();
    for (std::size_t i = 0; i < x.size(); ++i)
      x[i] = node.name == "mask" ? (i % 3 == 0 ? 1.0F : 0.0F) : static_cast<float>(i % 17) / 17.0F;
    inputs[node.name] = t;
  }
  ReferenceExecutor run(graph, weights);
  run.run(inputs);
  return run.tensor("0");
}

}  // namespace

TEST_CASE("the catalogue builds every model at any size that fits, with the inputs and outputs it lists") {
  for (const Model& model : catalogue()) {
    CAPTURE(model.name);
    CHECK(&find_model(model.name) == &model);
    const std::int64_t side = 2 * model.size.multiple;
    const auto graph = build_model(model.name, {.height = side, .width = side + model.size.multiple});
    std::vector<std::string> inputs;
    for (const Node& node : graph->nodes())
      if (node.kind == NodeKind::kInput) inputs.push_back(node.name);
    CHECK(std::ranges::equal(inputs, model.inputs));
    REQUIRE(graph->outputs().size() == model.outputs.size());
    for (std::size_t i = 0; i < model.outputs.size(); ++i) {
      CHECK(graph->outputs()[i].first == std::to_string(i));
      const Shape& shape = graph->node(graph->outputs()[i].second).shape;
      CHECK(shape[2] == side);
      CHECK(shape[3] == side + model.size.multiple);
    }
  }
}

TEST_CASE("an unknown model's message lists the known ones") {
  const std::string message = message_of([] { (void)find_model("midas"); });
  CHECK(contains(message, "no model named midas"));
  CHECK(contains(message, "midas_v21_small"));
}

TEST_CASE("a size that a network cannot take is a usage error that names the network and the multiple") {
  struct Case {
    std::string name;
    std::int64_t height, width;
  };
  const std::vector<Case> wrong{{"midas_v21", 96, 100},
                                {"midas_v21_small", 31, 32},
                                {"inpaint_coarse", 70, 64},
                                {"inpaint_deepfill", 64, 68},
                                {"fba", 60, 64},
                                {"u2net", 0, 320},
                                {"u2netp", -1, 5}};
  for (const Case& c : wrong) {
    CAPTURE(c.name);
    const BuildOptions options{.height = c.height, .width = c.width};
    CHECK(kind_of([&] { (void)build_model(c.name, options); }) == ErrorKind::kUsage);
    const std::string message = message_of([&] { (void)build_model(c.name, options); });
    CHECK(contains(message, c.name));
    CHECK(contains(message, std::to_string(c.height) + "x" + std::to_string(c.width)));
    if (find_model(c.name).size.multiple > 1)
      CHECK(contains(message, "multiples of " + std::to_string(find_model(c.name).size.multiple)));
  }
}

TEST_CASE("weights that lack a layer or hold it in another shape are named with the file") {
  const auto graph = build_model("inpaint_coarse", {.height = 8, .width = 8});
  WeightMap weights("broken.safetensors");
  for (const Node& node : graph->nodes())
    if (node.kind == NodeKind::kParameter && node.name != "conv7.conv.bias")
      weights.set(
          node.name,
          Tensor::zeros(DType::kF32, node.name == "conv9.conv.weight" ? Shape{192, 96, 5, 5} : node.shape));
  CHECK(kind_of([&] { ReferenceExecutor run(*graph, weights); }) == ErrorKind::kBadWeights);
  const std::string message = message_of([&] { ReferenceExecutor run(*graph, weights); });
  CHECK(contains(message, "broken.safetensors"));
  CHECK(contains(message, "missing (1): conv7.conv.bias"));
  CHECK(contains(message, "conv9.conv.weight: has 192x96x5x5, the network needs 192x96x3x3"));
}

TEST_CASE("the coarse network's shapes say how wide it is and whether the last layer is gated") {
  const auto table = InpaintCoarseConfig::from_weights(coarse_shapes({48, 6, 5, 5}, {4, 12, 3, 3}));
  CHECK(table.width == 24);
  CHECK(table.image_channels == 4);
  CHECK_FALSE(table.gated_last);
  const auto doubled = InpaintCoarseConfig::from_weights(coarse_shapes({96, 6, 5, 5}, {8, 24, 3, 3}));
  CHECK(doubled.width == 48);
  CHECK(doubled.gated_last);
  const auto rgb = InpaintCoarseConfig::from_weights(coarse_shapes({48, 5, 5, 5}, {3, 12, 3, 3}));
  CHECK(rgb.image_channels == 3);
  const auto made_up = InpaintCoarseConfig::from_weights(FormulaWeights::made_up());
  CHECK(made_up.width == 24);
}

TEST_CASE("coarse networks of either filter convention, gated at the end or not, run and stay in [-1,1]") {
  for (const std::int64_t filters : {8, 16})
    for (const std::int64_t last : {4, 8}) {
      CAPTURE(filters);
      CAPTURE(last);
      const WeightMap shapes = coarse_shapes({filters, 6, 5, 5}, {last, filters / 4, 3, 3});
      const auto graph = build_model("inpaint_coarse", {.height = 8, .width = 12, .weights = &shapes});
      CHECK(graph->node(*graph->find("conv16.conv.weight")).shape == Shape{last, filters / 4, 3, 3});
      CHECK(graph->node(*graph->find("conv6.conv.weight")).shape == Shape{4 * filters, 2 * filters, 3, 3});
      const Tensor result = run_made_up(*graph, FormulaWeights::made_up());
      CHECK(result.shape() == Shape{1, 4, 8, 12});
      CHECK(max_abs(result) <= 1);
      CHECK(max_abs(result) > 1e-3);
    }
}

TEST_CASE("weights that fit no inpainting network are refused with the shapes that do not fit") {
  const std::vector<WeightMap> bad{
      coarse_shapes({48, 6, 5, 5}, {5, 12, 3, 3}),      // neither 4 nor 8 filters at the end
      coarse_shapes({48, 2, 5, 5}, {4, 12, 3, 3}),      // no image channel beside ones and mask
      coarse_shapes({50, 6, 5, 5}, {4, 12, 3, 3}),      // half of 25 channels
      coarse_shapes({48, 6, 5}, {4, 12, 3, 3}),         // not a filter bank
      coarse_shapes({1 << 20, 6, 1, 1}, {4, 12, 3, 3})  // far too many filters
  };
  for (const WeightMap& weights : bad) {
    CHECK(kind_of([&] { (void)InpaintCoarseConfig::from_weights(weights); }) == ErrorKind::kBadWeights);
    CHECK(contains(message_of([&] { (void)InpaintCoarseConfig::from_weights(weights); }), "has shape"));
  }
  const std::string message = message_of([] {
    (void)InpaintCoarseConfig::from_weights(shapes_only({{"a", {1}}}));
  });
  CHECK(contains(message, "conv1.conv.weight is missing"));
}

TEST_CASE("the two-stage network takes its channel number and RGB or RGBD from the shapes") {
  const auto rgbd =
      InpaintDeepfillConfig::from_weights(shapes_only({{"stage1.conv1.conv.weight", {48, 6, 5, 5}}}));
  CHECK(rgbd.cnum == 48);
  CHECK(rgbd.image_channels == 4);
  const WeightMap narrow = shapes_only({{"stage1.conv1.conv.weight", {8, 5, 5, 5}}});
  const auto graph = build_model("inpaint_deepfill", {.height = 16, .width = 24, .weights = &narrow});
  CHECK(graph->node(*graph->find("rgbd")).shape == Shape{1, 3, 16, 24});
  CHECK(graph->node(*graph->find("stage2.conv_bn6.conv.weight")).shape == Shape{32, 32, 3, 3});
  const Tensor result = run_made_up(*graph, FormulaWeights::made_up());
  CHECK(max_abs(result) <= 1);
  CHECK(
      kind_of([] {
        (void)InpaintDeepfillConfig::from_weights(shapes_only({{"stage1.conv1.conv.weight", {6, 6, 5, 5}}}));
      }) == ErrorKind::kBadWeights);
}

TEST_CASE("Depth Anything V2's size is a multiple of 14, at least 518 on the shorter side") {
  // The numbers of the authors' Resize: 518/100·133 = 688.9 is nearest to 686, 518/1000·1500 = 777 to 784
  // (55.5 patches, a tie, to the even 56).
  CHECK(depth_anything_working_size({100, 133}) == ImageSize{518, 686});
  CHECK(depth_anything_working_size({1500, 1000}) == ImageSize{784, 518});
  CHECK(depth_anything_working_size({3000, 4000}, 100) == ImageSize{112, 140});
  CHECK_THROWS_AS((void)depth_anything_working_size({0, 10}), Error);
}

TEST_CASE("every depth network works at its authors' size, or at a side that is asked for") {
  const FormulaWeights weights = FormulaWeights::made_up();
  const auto working_size = [&](const NetworkChoice& network) {
    Graph g;
    (void)estimate_disparity(g.input("image", {1, 3, 60, 90}), network);
    const auto first = std::ranges::find_if(
        g.nodes(), [](const Node& node) { return node.op != nullptr && node.op->type() == "conv2d"; });
    const Shape& x = g.node(first->inputs[0]).shape;
    return ImageSize{x[2], x[3]};
  };
  struct Case {
    const char* model;
    std::int64_t side;
    ImageSize size;
  };
  for (const Case& c :
       {Case{"slide_depth", 0, {256, 384}}, Case{"slide_depth", 192, {128, 192}},
        Case{"midas_v21", 0, {256, 384}}, Case{"midas_v21", 512, {352, 512}},
        Case{"midas_v21_small", 0, {160, 256}}, Case{"midas_v21_small", 96, {64, 96}},
        Case{"depth_anything_v2_vits", 0, {518, 784}}, Case{"depth_anything_v2_vits", 28, {28, 42}}}) {
    CAPTURE(c.model);
    CHECK(working_size({c.model, &weights, c.side}) == c.size);
  }
  for (const Case& c : {Case{"slide_depth", 400, {}}, Case{"depth_anything_v2_vits", 512, {}},
                        Case{"midas_v21", -32, {}}, Case{"u2net", 0, {}}})
    CHECK(kind_of([&] { (void)depth_side({c.model, &weights, c.side}); }) == ErrorKind::kUsage);
}

TEST_CASE("filters whose means are zero are taken as standardised already") {
  WeightMap weights;
  const std::array<float, 8> centred{1, -1, 1, -1, 2, -2, -1, 1};
  weights.set("encoder.conv1.weight", Tensor::from<float>({2, 1, 2, 2}, std::span<const float>(centred)));
  CHECK_FALSE(FbaConfig::from_weights(weights).standardise_weights);
  const std::array<float, 8> raw{1, -1, 1, -1, 2, -2, -1, 1.1F};
  weights.set("encoder.conv1.weight", Tensor::from<float>({2, 1, 2, 2}, std::span<const float>(raw)));
  CHECK(FbaConfig::from_weights(weights).standardise_weights);
  CHECK_FALSE(FbaConfig::from_weights(FormulaWeights::made_up()).standardise_weights);
  weights.set("encoder.conv1.weight", Tensor::view(DType::kF32, {64, 11, 7, 7}, nullptr));
  CHECK_FALSE(FbaConfig::from_weights(weights).standardise_weights);  // a list of shapes
}
