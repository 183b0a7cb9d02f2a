#include "graphs/layering.h"

#include <doctest/doctest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "runtime/error.h"
#include "runtime/fast_executor.h"
#include "runtime/reference_executor.h"
#include "runtime/safetensors.h"

using namespace slide;
using namespace slide::graphs;

namespace {

Shape plane(const Tensor& t) { return {1, 1, t.shape()[0], t.shape()[1]}; }

void build(Graph& g, const Shape& shape, double parallax) {
  const Value d = g.input("D", shape);
  // The parameters that the golden maps were made with.
  const Layering layering =
      resolve({.parallax = parallax, .beta = 4 * std::numbers::ln2 * parallax * parallax, .sigma = 1});
  const LayeringMaps maps = soft_layering(d, layering);
  g.output("D1", maps.disparity);
  g.output("A", maps.visibility);
  g.output("S", maps.disocclusion);
  g.output("S_hat", maps.occlusion);
  g.output("H", maps.hole);
}

const double kParallaxes[] = {1.5, 6.0, 40.0};

std::string prefix(double parallax) { return parallax == 1.5 ? "P1.5." : parallax == 6.0 ? "P6." : "P40."; }

}  // namespace

TEST_CASE("soft layering agrees with the definition evaluated pair by pair in NumPy") {
  const SafetensorsFile golden = SafetensorsFile::open(SLIDE_TEST_DATA "/layering/maps.safetensors");
  const Shape shape = plane(golden.tensor("D"));
  const NamedTensors inputs = {{"D", golden.tensor("D").reshaped(shape)}};
  for (const double parallax : kParallaxes) {
    Graph g;
    build(g, shape, parallax);
    ReferenceExecutor reference(g, WeightMap());
    reference.run(inputs);
    FastExecutor fast(g, WeightMap());
    fast.run(inputs);
    for (const char* name : {"D1", "A", "S", "S_hat", "H"}) {
      CAPTURE(parallax);
      CAPTURE(name);
      const Tensor wanted = golden.tensor(prefix(parallax) + name).reshaped(shape);
      CHECK(max_abs_difference(reference.tensor(name), wanted) <= 1e-12 * (1 + parallax));
      // float32: D1 carries a few u; A multiplies its slope by up to sqrt(2·beta/e), S by gamma = P.
      CHECK(max_abs_difference(fast.tensor(name), wanted) <= 0x1p-24 * 16 * (1 + parallax));
    }
  }
}

TEST_CASE("where neighbours are pulled sqrt(12 ln 2) pixels apart the visibility is one half") {
  // A plane of slope g: P·g = sqrt(12·ln 2) must give A = 1/2 in the interior, whatever P is.
  for (const double parallax : {4.0, 25.0}) {
    Graph g;
    const Value d = g.input("D", {1, 1, 9, 9});
    Layering layering = resolve({.parallax = parallax});
    g.output("A", visibility(d, layering));
    Tensor ramp(DType::kF64, {1, 1, 9, 9});
    for (int i = 0; i < 81; ++i)
      ramp.mutable_data<double>()[static_cast<std::size_t>(i)] =
          std::sqrt(12 * std::numbers::ln2) / parallax * (i % 9);
    ReferenceExecutor run(g, WeightMap());
    run.run({{"D", ramp}});
    CHECK(run.tensor("A").data<double>()[40] == doctest::Approx(0.5).epsilon(1e-12));
  }
}

TEST_CASE("by default the disparity of a subject with a sharp edge keeps its two values") {
  // Without blur a step is moved outwards by the max-pool of 3 and stays a step: no depth in between.
  Graph g;
  const Value d = g.input("D", {1, 1, 1, 20});
  g.output("D1", condition_disparity(d, resolve({.parallax = 8})));
  Tensor step = Tensor::zeros(DType::kF64, {1, 1, 1, 20});
  for (std::size_t i = 10; i < 20; ++i) step.mutable_data<double>()[i] = 1;
  ReferenceExecutor run(g, WeightMap());
  run.run({{"D", step}});
  for (std::size_t i = 0; i < 20; ++i) CHECK(run.tensor("D1").data<double>()[i] == (i < 9 ? 0 : 1));
}

TEST_CASE("a flat scene is all foreground and has no hole") {
  Graph g;
  build(g, {1, 1, 12, 10}, 20);
  const Tensor flat = Tensor::zeros(DType::kF64, {1, 1, 12, 10});
  ReferenceExecutor run(g, WeightMap());
  run.run({{"D", flat}});
  CHECK(max_abs(run.tensor("S")) == 0);
  CHECK(max_abs(run.tensor("S_hat")) == 0);
  CHECK(max_abs(run.tensor("H")) == 0);
  for (const double a : run.tensor("A").data<double>()) CHECK(a == 1);
}

TEST_CASE("a step uncovers as many pixels as the parallax pulls it apart") {
  // Disparity 0 | 1, P = 8: behind the edge pixel 7 more pixels may come into view; S falls with the
  // uncovered width.
  Graph g;
  const Value d = g.input("D", {1, 1, 1, 40});
  const Layering layering = resolve({.parallax = 8, .sigma = 0, .maxpool = 1});
  g.output("S", disocclusion(condition_disparity(d, layering), layering));
  Tensor step = Tensor::zeros(DType::kF64, {1, 1, 1, 40});
  for (std::size_t i = 20; i < 40; ++i) step.mutable_data<double>()[i] = 1;
  ReferenceExecutor run(g, WeightMap());
  run.run({{"D", step}});
  const auto s = run.tensor("S").data<double>();
  for (std::size_t i = 0; i < 40; ++i) {
    const double uncovered = i < 20 ? 0 : std::max(0.0, 8.0 - static_cast<double>(i - 19));
    CHECK(s[i] == doctest::Approx(std::tanh(uncovered)).epsilon(1e-12));
  }
}

TEST_CASE("a followed matte is the visibility, shows what is behind, and its opaque part decides the hole") {
  // One row. The subject's layer ends at column 12, its opaque part at 20; between it is see-through. P = 8.
  constexpr std::int64_t kWidth = 40;
  Graph g;
  const Shape shape{1, 1, 1, kWidth};
  const Layering layering = resolve({.parallax = 8});
  const FollowedMatte matte{g.input("M", shape), g.input("p", shape), g.input("opaque", shape)};
  const LayeringMaps maps = soft_layering(g.input("D", shape), layering, matte);
  g.output("A", maps.visibility);
  g.output("S", maps.disocclusion);
  g.output("H", maps.hole);
  NamedTensors inputs;
  for (const char* name : {"M", "p", "opaque", "D"}) inputs[name] = Tensor::zeros(DType::kF64, shape);
  for (std::size_t i = 12; i < kWidth; ++i) {
    inputs["D"].mutable_data<double>()[i] = inputs["p"].mutable_data<double>()[i] = 1;
    inputs["opaque"].mutable_data<double>()[i] = i < 20 ? 0 : 1;
    inputs["M"].mutable_data<double>()[i] = std::min(1.0, static_cast<double>(i - 12) / 8);
  }
  ReferenceExecutor run(g, WeightMap());
  run.run(inputs);
  for (std::size_t i = 0; i < kWidth; ++i) {
    CAPTURE(i);
    // The max-pool of 3 moves every outline outwards by a pixel: the layer begins at 11. Column 10 is the
    // last of the background, where neighbours are pulled apart by half a step: beta = 64/12, a slope of 1/2.
    const double seen = i < 10    ? 1
                        : i == 10 ? std::exp(-64.0 / 12 / 4)
                        : i < 12  ? 0
                                  : inputs["M"].data<double>()[i];
    CHECK(run.tensor("A").data<double>()[i] == doctest::Approx(seen).epsilon(1e-12));
    // See-through columns are uncovered wholly; behind the opaque edge, at 19, 7 more come into view.
    const double uncovered = i < 19 ? 0 : std::max(0.0, 8.0 - static_cast<double>(i - 18));
    const double hole = i >= 11 && i < 20 ? 1 : std::tanh(uncovered);
    CHECK(run.tensor("S").data<double>()[i] == doctest::Approx(hole).epsilon(1e-12));
    CHECK(run.tensor("H").data<double>()[i] == (i >= 10 && i < 27 ? 1 : 0));
  }
}

TEST_CASE("without parallax nothing is see-through and nothing is uncovered") {
  const Layering layering = resolve({.parallax = 0});
  CHECK(layering.beta == 0);
  CHECK(layering.gamma == 0);
  CHECK(layering.radius == 0);
}

TEST_CASE("layering parameters out of range are refused by name") {
  CHECK_THROWS_WITH_AS((void)resolve({.parallax = -1}), doctest::Contains("parallax"), Error);
  CHECK_THROWS_WITH_AS((void)resolve({.parallax = 4, .beta = -2.0}), doctest::Contains("beta"), Error);
  CHECK_THROWS_WITH_AS((void)resolve({.parallax = 4, .radius = -1}), doctest::Contains("radius"), Error);
  CHECK_THROWS_WITH_AS((void)resolve({.parallax = 4, .maxpool = 4}), doctest::Contains("maxpool"), Error);
}
