#include <doctest/doctest.h>

#include <string>

#include "graphs/slide_depth.h"
#include "graphs/slide_inpaint.h"
#include "graphs/slide_matte.h"
#include "graphs/stages.h"
#include "ops/fill/fill.h"
#include "ops/pointwise/pointwise.h"
#include "runtime/error.h"
#include "runtime/fast_executor.h"
#include "runtime/reference_executor.h"
#include "runtime/safetensors.h"

using namespace slide;
using namespace slide::graphs;

namespace {

SafetensorsFile golden() { return SafetensorsFile::open(SLIDE_TEST_DATA "/slide_networks.safetensors"); }

SafetensorsWeights default_weights(const std::string& model) {
  return SafetensorsWeights(
      SafetensorsFile::open(SLIDE_TEST_DATA "/../../weights/" + model + ".safetensors"));
}

void build(Graph& g, const std::string& model) {
  const auto map = [&](const char* name, std::int64_t channels) {
    return g.input(name, {1, channels, 64, 96});
  };
  if (model == "slide_depth")
    g.output("0", slide_depth(map("photo", 3)));
  else if (model == "slide_matte")
    g.output("0", slide_matte(map("photo", 3)));
  else
    g.output("0", slide_inpaint(map("rgbd", 4), map("disparity", 1), map("hole", 1)));
}

NamedTensors inputs(const SafetensorsFile& file, const std::string& model) {
  if (model != "slide_inpaint") return {{"photo", file.tensor("photo")}};
  return {
      {"rgbd", file.tensor("rgbd")}, {"disparity", file.tensor("disparity")}, {"hole", file.tensor("hole")}};
}

}  // namespace

TEST_CASE("the default networks with the default weights agree with PyTorch in float64") {
  const SafetensorsFile file = golden();
  for (const char* model : {"slide_depth", "slide_matte", "slide_inpaint"}) {
    CAPTURE(model);
    Graph g;
    build(g, model);
    const SafetensorsWeights weights = default_weights(model);
    const Tensor wanted = file.tensor(model);
    ReferenceExecutor reference(g, weights);
    reference.run(inputs(file, model));
    CHECK(max_abs_difference(reference.tensor("0"), wanted) <= 1e-9 * max_abs(wanted));
    // float32: some hundred roundings of numbers no larger than a few times the result, one layer after the
    // other.
    FastExecutor fast(g, weights);
    fast.run(inputs(file, model));
    CHECK(max_abs_difference(fast.tensor("0"), wanted) <= 1e-5 * max_abs(wanted));
  }
}

TEST_CASE("slide_matte's matte at the photo's size agrees with PyTorch and the guided filter in numpy") {
  const SafetensorsFile file = golden();
  const SafetensorsWeights weights = default_weights("slide_matte");
  const Tensor wanted = file.tensor("matte_stage");
  Graph g;
  const Value photo = g.input("photo", {1, 3, 64, 96});
  g.output("M", estimate_matte(ops::affine(photo, 0.5, 0.5), {"slide_matte", &weights}));
  FastExecutor run(g, weights);
  run.run({{"photo", file.tensor("photo")}});
  // float32's roundings in the network, as above; the guided filter is in float64.
  CHECK(max_abs_difference(run.tensor("M"), wanted) <= 1e-5);
}

TEST_CASE("the weights of the background and the fill agree with PyTorch in float64") {
  const SafetensorsFile file = SafetensorsFile::open(SLIDE_TEST_DATA "/ops/fill.safetensors");
  Graph g;
  const Value rgbd = g.input("rgbd", {1, 4, 20, 28});
  const Value d = g.input("d", {1, 1, 20, 28});
  const Value hole = g.input("hole", {1, 1, 20, 28});
  const Value weight = background_weight(d, hole);
  g.output("weight", weight);
  g.output("colours", colour_weight(d, ops::push_pull_fill(d, weight, 4)));
  g.output("filled", background_fill(rgbd, d, hole));
  ReferenceExecutor run(g, WeightMap());
  run.run({{"rgbd", file.tensor("scene.rgbd")},
           {"d", file.tensor("scene.d")},
           {"hole", file.tensor("scene.hole")}});
  for (const char* name : {"weight", "colours", "filled"}) {
    CAPTURE(name);
    CHECK(max_abs_difference(run.tensor(name), file.tensor(std::string("scene.") + name)) <= 1e-13);
  }
}

TEST_CASE("the fill leaves the background as it is and brings none of the foreground into the hole") {
  // A red square before a blue wall; the hole is its right half.
  constexpr std::int64_t kSide = 32;
  Graph g;
  const Value rgbd = g.input("rgbd", {1, 4, kSide, kSide});
  const Value d = g.input("d", {1, 1, kSide, kSide});
  const Value hole = g.input("hole", {1, 1, kSide, kSide});
  g.output("filled", background_fill(rgbd, d, hole));
  Tensor pixels = Tensor::zeros(DType::kF64, {1, 4, kSide, kSide});
  Tensor disparity = Tensor::zeros(DType::kF64, {1, 1, kSide, kSide});
  Tensor mask = Tensor::zeros(DType::kF64, {1, 1, kSide, kSide});
  for (std::size_t i = 0; i < kSide * kSide; ++i) {
    const std::size_t row = i / kSide;
    const std::size_t column = i % kSide;
    const bool square = row >= 8 && row < 24 && column >= 8 && column < 24;
    pixels.mutable_data<double>()[square ? i : 2 * kSide * kSide + i] = 1;
    disparity.mutable_data<double>()[i] = square ? 0.9 : 0.1;
    pixels.mutable_data<double>()[3 * kSide * kSide + i] = square ? 0.8 : -0.8;
    mask.mutable_data<double>()[i] = square && column >= 16 ? 1 : 0;
  }
  ReferenceExecutor run(g, WeightMap());
  run.run({{"rgbd", pixels}, {"d", disparity}, {"hole", mask}});
  const auto filled = run.tensor("filled").data<double>();
  for (std::size_t i = 0; i < kSide * kSide; ++i) {
    CHECK(filled[i] <= 1e-3);                                    // no red, in the square either
    CHECK(filled[2 * kSide * kSide + i] >= 1 - 1e-3);            // blue
    CHECK(filled[3 * kSide * kSide + i] <= 2 * 0.1 - 1 + 1e-3);  // far
  }
}

TEST_CASE("the default networks refuse sizes they cannot take") {
  Graph g;
  const Value photo = g.input("photo", {1, 3, 64, 100});
  CHECK_THROWS_WITH_AS((void)slide_depth(photo), doctest::Contains("multiples of 32"), Error);
  CHECK_THROWS_WITH_AS((void)slide_matte(photo), doctest::Contains("multiples of 32"), Error);
  const Value odd = g.input("odd", {1, 4, 63, 64});
  const Value map = g.input("map", {1, 1, 63, 64});
  CHECK_THROWS_WITH_AS((void)slide_inpaint(odd, map, map), doctest::Contains("multiples of 4"), Error);
}
