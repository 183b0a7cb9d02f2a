#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "graphs/formula_weights.h"
#include "graphs/slide.h"
#include "graphs/stages.h"
#include "network_support.h"
#include "runtime/fast_executor.h"
#include "runtime/reference_executor.h"
#include "runtime/safetensors.h"

using namespace slide;
using namespace slide::graphs;

namespace {

constexpr std::int64_t kHeight = 18;
constexpr std::int64_t kWidth = 29;

Tensor texture() {
  Tensor image(DType::kF32, {1, 3, kHeight, kWidth});
  const std::span<float> v = image.mutable_data<float>();
  for (std::size_t i = 0; i < v.size(); ++i) v[i] = 0.5F + 0.4F * std::sin(0.37F * static_cast<float>(i));
  return image;
}

/// 0 on the left up to column 9, 1 from column 20, a ramp between whose numbers are not near a threshold.
Tensor ramp() {
  Tensor map(DType::kF32, {1, 1, kHeight, kWidth});
  const std::span<float> v = map.mutable_data<float>();
  for (std::size_t i = 0; i < v.size(); ++i)
    v[i] = std::clamp((static_cast<float>(i % kWidth) - 9.5F) / 10.0F, 0.0F, 1.0F);
  return map;
}

/// The graph of refine_matte() alone.
void build_refinement(Graph& g, const NetworkChoice& network) {
  g.output("M", refine_matte(g.input("image", {1, 3, kHeight, kWidth}),
                             g.input("saliency", {1, 1, kHeight, kWidth}), network));
}

Tensor run_fast(const Graph& g, const WeightSource& weights, const NamedTensors& inputs,
                const std::string& output) {
  FastExecutor run(g, weights);
  run.run(inputs);
  return run.tensor(output).clone();
}

Tensor run_reference(const Graph& g, const NamedTensors& inputs, const std::string& output) {
  ReferenceExecutor run(g, WeightMap());
  run.run(inputs);
  return run.tensor(output).clone();
}

std::vector<std::string> names_of(const std::vector<StageReport>& stages) {
  std::vector<std::string> names;
  for (const StageReport& stage : stages) names.push_back(stage.name);
  return names;
}

}  // namespace

TEST_CASE("the trimap and its transform are those of SciPy's and OpenCV's distance transforms") {
  const auto file = SafetensorsFile::open(std::string(SLIDE_TEST_DATA) + "/trimap.safetensors");
  const Tensor m = file.tensor("saliency");
  const Tensor regions = file.tensor("trimap");
  const Tensor expected = file.tensor("transformed");
  Graph g;
  const Value saliency = g.input("M", {1, 1, m.shape()[0], m.shape()[1]});
  const Value t = trimap(saliency);
  g.output("trimap", t);
  g.output("transformed", trimap_transform(t));
  const NamedTensors inputs = {{"M", m.reshaped(saliency.shape())}};
  const auto check = [&](const auto& result, double bound) {
    const Tensor y = result("trimap").to(DType::kF64);
    for (std::int64_t i = 0; i < y.count(); ++i) {
      const auto at = static_cast<std::size_t>(i);
      REQUIRE(y.data<double>()[at] == static_cast<double>(regions.data<std::uint8_t>()[at]));
    }
    const Tensor z = result("transformed");
    CHECK(max_abs_difference(z, expected.reshaped(z.shape())) <= bound);
  };
  // OpenCV's distance d is rounded to float32, twice that in d², and t·exp(-t) is at most 1/e; then
  // storage: 7.4e-8.
  check([&](const std::string& output) { return run_reference(g, inputs, output); }, 7.5e-8);
  // The kernels add three roundings of the exponent and two of the exponential: 1.9e-7.
  check([&](const std::string& output) { return run_fast(g, WeightMap(), inputs, output); }, 2.7e-7);
}

TEST_CASE("a region without pixels transforms to zeros") {
  Graph g;
  g.output("y", trimap_transform(g.input("trimap", {1, 2, 6, 7})));
  const NamedTensors none = {{"trimap", Tensor::zeros(DType::kF32, {1, 2, 6, 7})}};
  CHECK(max_abs(run_reference(g, none, "y")) == 0);
  CHECK(max_abs(run_fast(g, WeightMap(), none, "y")) == 0);
}

TEST_CASE("a refined matte is exactly 0 and 1 where the trimap is sure, and in [0, 1] between") {
  const FormulaWeights formula = FormulaWeights::made_up();
  Graph g;
  build_refinement(g, {"fba", &formula});
  const WeightMap weights = weights_in_memory(g, formula);
  const NamedTensors inputs = {{"image", texture()}, {"saliency", ramp()}};
  const Tensor alpha = run_fast(g, weights, inputs, "M");
  REQUIRE(alpha.shape() == Shape{1, 1, kHeight, kWidth});
  std::size_t between = 0;
  for (std::int64_t i = 0; i < alpha.count(); ++i) {
    const std::int64_t column = i % kWidth;
    const float a = alpha.data<float>()[static_cast<std::size_t>(i)];
    CAPTURE(column);
    REQUIRE((a >= 0 && a <= 1));
    // The first column above 0.1 is 11, the last up to 0.9 is 18; three pixels from them all is sure.
    if (column <= 8) REQUIRE(a == 0);
    if (column >= 21) REQUIRE(a == 1);
    between += a > 0 && a < 1 ? 1 : 0;
  }
  CHECK(between > 0);
  if (quick()) return;
  ReferenceExecutor reference(g, weights);
  reference.run(inputs);
  // What PyTorch's own float32 run of the network differs from float64 by (docs/networks.md).
  // Measured: 5.5e-6.
  const double difference = max_abs_difference(reference.tensor("M"), alpha);
  INFO("difference ", difference);
  CHECK(difference < 1.6e-5);
}

namespace {

/// slide_rim's weights, its last layer a constant change of the log odds.
WeightMap constant_rim(double change) {
  const auto file = SafetensorsFile::open(SLIDE_TEST_DATA "/../../weights/slide_rim.safetensors");
  WeightMap weights;
  for (const std::string& name : file.names()) weights.set(name, file.tensor(name));
  weights.set("conv13.weight", Tensor::zeros(DType::kF64, file.tensor("conv13.weight").shape()));
  Tensor bias = Tensor::zeros(DType::kF64, {1});
  bias.mutable_data<double>()[0] = change;
  weights.set("conv13.bias", bias);
  return weights;
}

}  // namespace

TEST_CASE("slide_rim takes a photo of any size, and where it says nothing the matte stays but for haze") {
  const WeightMap weights = constant_rim(0);
  Graph g;
  build_refinement(g, {"slide_rim", &weights});
  const Tensor alpha = run_fast(g, weights, {{"image", texture()}, {"saliency", ramp()}}, "M");
  REQUIRE(alpha.shape() == Shape{1, 1, kHeight, kWidth});
  // p and the odds are rounded to float32, a few times, and what comes of them is stretched by 1 / 0.84.
  const Tensor coarse = ramp();
  for (std::size_t i = 0; i < static_cast<std::size_t>(alpha.count()); ++i) {
    const double wanted =
        std::clamp((static_cast<double>(coarse.data<float>()[i]) - 1.0 / 16) * 8 / 7, 0.0, 1.0);
    REQUIRE(std::abs(static_cast<double>(alpha.data<float>()[i]) - wanted) <= 1e-6);
  }
}

TEST_CASE("slide_rim works on large photos reduced, and its matte comes back at the photo's size") {
  constexpr std::int64_t kLong = 3072;  // twice what it works at
  const WeightMap weights = constant_rim(std::log(24.0));
  Graph g;
  g.output("M", refine_matte(g.input("image", {1, 3, 32, kLong}), g.input("saliency", {1, 1, 32, kLong}),
                             {"slide_rim", &weights}));
  std::int64_t widest = 0;
  for (const Node& node : g.nodes())
    if (node.shape.rank() == 4 && node.shape[1] == 16) widest = std::max(widest, node.shape[3]);
  CHECK(widest == kLong / 2);  // the network's last features
  Tensor image = Tensor::zeros(DType::kF32, {1, 3, 32, kLong});
  std::ranges::fill(image.mutable_data<float>(), 0.5F);
  const Tensor alpha = run_fast(
      g, weights, {{"image", image}, {"saliency", Tensor::zeros(DType::kF32, {1, 1, 32, kLong})}}, "M");
  // Odds of 2 : 98, times 24, are 24 : 49.
  for (const float a : alpha.data<float>()) REQUIRE(std::abs(a - (24.0 / 73 - 0.08) / 0.84) <= 1e-5);
}

TEST_CASE("a network that is none for matting is refused by name") {
  const FormulaWeights weights = FormulaWeights::made_up();
  Graph g;
  CHECK(message_of([&] {
          build_refinement(g, {"u2net", &weights});
        }).find("u2net is no matting network") != std::string::npos);
}

TEST_CASE("the matting network runs after the saliency network, and not on a matte that was given") {
  const FormulaWeights weights = FormulaWeights::made_up();
  SlideModels models;
  models.saliency = {"slide_matte", &weights};
  models.matting = {"fba", &weights};
  SlideOptions options;
  options.layering.parallax = 0;  // no hole: nothing is inpainted
  options.matte = MatteUse::kAlways;
  SlideInput input{texture(), ramp(), {}};

  std::vector<std::string> planned;
  for (const PlannedStage& stage : plan_layers(kHeight, kWidth, models, input, options))
    planned.push_back(stage.report.name);
  CHECK(planned == std::vector<std::string>{"saliency", "matting", "subject", "layering", "inpainting"});

  const SlideLayers made = make_layers(input, models, options);
  CHECK(names_of(made.report.stages) ==
        std::vector<std::string>{"depth", "saliency", "matting", "subject", "layering"});
  CHECK(made.report.matte_used);
  CHECK(made.report.matte_refined);
  for (const float a : made.matte.data<float>()) REQUIRE((a >= 0 && a <= 1));

  input.matte = ramp();
  const SlideLayers given = make_layers(input, models, options);
  CHECK(names_of(given.report.stages) == std::vector<std::string>{"depth", "subject", "layering"});
  CHECK(given.report.matte_used);
  CHECK(!given.report.matte_refined);
  CHECK(max_abs_difference(given.matte, input.matte) == 0);
}
