#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "graphs/slide_depth.h"
#include "graphs/slide_inpaint.h"
#include "graphs/slide_matte.h"
#include "graphs/slide_rim.h"
#include "graphs/stages.h"
#include "ops/fill/fill.h"
#include "ops/pointwise/pointwise.h"
#include "ops/tensor_shape/tensor_shape.h"
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
  else if (model == "slide_rim")
    g.output("0", slide_rim(ops::affine(map("photo", 3), 0.5, 0.5), map("coarse", 1)));
  else
    g.output("0", slide_inpaint(map("rgbd", 4), map("disparity", 1), map("hole", 1)));
}

NamedTensors inputs(const SafetensorsFile& file, const std::string& model) {
  if (model == "slide_rim") return {{"photo", file.tensor("photo")}, {"coarse", file.tensor("coarse")}};
  if (model != "slide_inpaint") return {{"photo", file.tensor("photo")}};
  return {
      {"rgbd", file.tensor("rgbd")}, {"disparity", file.tensor("disparity")}, {"hole", file.tensor("hole")}};
}

}  // namespace

TEST_CASE("the default networks with the default weights agree with PyTorch in float64") {
  const SafetensorsFile file = golden();
  for (const char* model : {"slide_depth", "slide_matte", "slide_inpaint", "slide_rim"}) {
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
  const Value part = ops::slice(ops::slice(photo, 2, 12, 60), 3, 20, 84);  // the disc fills a third of it
  g.output("M", estimate_matte(ops::affine(part, 0.5, 0.5), {"slide_matte", &weights}));
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
  const SubjectMatte matte{g.input("clear", {1, 1, 20, 28}), g.input("agreement", {1, 1, 20, 28})};
  const Value behind = ops::push_pull_fill(d, weight, 4);
  {
    const auto scope = g.scope("matted");
    g.output("matted.colours", matted_weight(colour_weight(d, behind), matte));
    g.output("matted.filled", background_fill(rgbd, d, hole, {.matte = matte}));
  }
  ReferenceExecutor run(g, WeightMap());
  run.run({{"rgbd", file.tensor("scene.rgbd")},
           {"d", file.tensor("scene.d")},
           {"hole", file.tensor("scene.hole")},
           {"clear", file.tensor("scene.clear")},
           {"agreement", file.tensor("scene.agreement")}});
  for (const char* name : {"weight", "colours", "filled", "matted.colours", "matted.filled"}) {
    CAPTURE(name);
    CHECK(max_abs_difference(run.tensor(name), file.tensor(std::string("scene.") + name)) <= 1e-13);
  }
}

TEST_CASE("with a reach, a subject's own relief is not what it covers") {
  Graph g;
  const Value d = g.input("d", {1, 1, 1, 24});
  const Value hole = g.input("hole", {1, 1, 1, 24});
  g.output("plain", background_weight(d, hole));
  g.output("reaching", background_weight(d, hole, 12));
  // The background, the rim that covers it, and a hollow of the subject a little behind its rim.
  std::vector<double> disparity(24, 0.1), in_hole(24, 0.0);
  std::fill(disparity.begin() + 8, disparity.begin() + 12, 0.9);
  std::fill(disparity.begin() + 12, disparity.end(), 0.86);
  std::fill(in_hole.begin() + 8, in_hole.begin() + 12, 1.0);
  const Shape row{1, 1, 1, 24};
  ReferenceExecutor run(g, WeightMap());
  run.run({{"d", Tensor::from(row, std::span<const double>(disparity))},
           {"hole", Tensor::from(row, std::span<const double>(in_hole))}});
  const auto at = [&](const char* name, std::size_t i) { return run.tensor(name).data<double>()[i]; };
  for (const char* name : {"plain", "reaching"}) {
    CHECK(at(name, 4) == 1);
    CHECK(at(name, 10) == 1e-11);
  }
  CHECK(at("plain", 16) == doctest::Approx(16 * 0.04));
  CHECK(at("reaching", 16) == 1e-11);
}

TEST_CASE("a matte replaces the disparity's outline as far as it is followed") {
  constexpr double kRest = 1e-11;
  Graph g;
  const Value weight = g.input("weight", {1, 1, 1, 5});
  const SubjectMatte matte{g.input("clear", {1, 1, 1, 5}), g.input("agreement", {1, 1, 1, 5})};
  g.output("y", matted_weight(weight, matte));
  const auto row = [](std::vector<double> values) {
    return Tensor::from(Shape{1, 1, 1, 5}, std::span<const double>(values));
  };
  ReferenceExecutor run(g, WeightMap());
  run.run({{"weight", row({0, 1, 1, 0, 0.5})},
           {"clear", row({1, 0, 0, 0, 1})},
           {"agreement", row({1, 1, 0, 0.5, 0.5})}});
  const double wanted[] = {1, kRest, 1, kRest, 0.75};
  for (std::size_t i = 0; i < 5; ++i) CHECK(run.tensor("y").data<double>()[i] == wanted[i]);
}

TEST_CASE("a matte that is not followed leaves the fill's bytes as they are") {
  const SafetensorsFile file = golden();
  Graph g;
  const Shape map{1, 1, 64, 96};
  const Value rgbd = g.input("rgbd", map.with(1, 4));
  const Value d = g.input("disparity", map);
  const Value hole = g.input("hole", map);
  g.output("plain", background_fill(rgbd, d, hole));
  const SubjectMatte matte{g.input("clear", map), g.input("agreement", map)};
  {
    const auto scope = g.scope("matted");
    g.output("matted", background_fill(rgbd, d, hole, {.matte = matte}));
  }
  NamedTensors values = inputs(file, "slide_inpaint");
  values["clear"] = values["agreement"] = Tensor::zeros(DType::kF32, map);
  FastExecutor run(g, WeightMap());
  run.run(values);
  CHECK(max_abs_difference(run.tensor("matted"), run.tensor("plain")) == 0);
}

TEST_CASE(
    "slide_inpaint is the fill where its last layer says nothing, the picture where all is background") {
  const SafetensorsFile file = golden();
  const SafetensorsFile given =
      SafetensorsFile::open(SLIDE_TEST_DATA "/../../weights/slide_inpaint.safetensors");
  Graph g;
  const Shape map{1, 1, 64, 96};
  const Value rgbd = g.input("rgbd", map.with(1, 4));
  const Value d = g.input("disparity", map);
  const Value hole = g.input("hole", map);
  const Value network = slide_inpaint(rgbd, d, hole);
  g.output("network", network);
  g.output("fill", background_fill(rgbd, d, hole));
  g.output("colours", ops::slice(network, 1, 0, 3));
  g.output("picture", ops::slice(rgbd, 1, 0, 3));
  const auto difference = [&](double change, const char* a, const char* b) {
    WeightMap weights;
    for (const std::string& name : given.names()) weights.set(name, given.tensor(name));
    weights.set("conv13.weight", Tensor::zeros(DType::kF64, given.tensor("conv13.weight").shape()));
    Tensor bias = Tensor::zeros(DType::kF64, {1});
    bias.mutable_data<double>()[0] = change;
    weights.set("conv13.bias", bias);
    ReferenceExecutor run(g, weights);
    run.run(inputs(file, "slide_inpaint"));
    return max_abs_difference(run.tensor(a), run.tensor(b));
  };
  CHECK(difference(0, "network", "fill") <= 1e-12);
  CHECK(difference(-50, "network", "fill") > 0.1);
  CHECK(difference(50, "colours", "picture") <= 1e-12);
}

TEST_CASE("slide_rim only clears haze where its last layer says nothing, and can turn what is sure") {
  const SafetensorsFile file = golden();
  const SafetensorsFile given = SafetensorsFile::open(SLIDE_TEST_DATA "/../../weights/slide_rim.safetensors");
  Graph g;
  build(g, "slide_rim");
  const auto matte = [&](double change) {
    WeightMap weights;
    for (const std::string& name : given.names()) weights.set(name, given.tensor(name));
    weights.set("conv13.weight", Tensor::zeros(DType::kF64, given.tensor("conv13.weight").shape()));
    Tensor bias = Tensor::zeros(DType::kF64, {1});
    bias.mutable_data<double>()[0] = change;
    weights.set("conv13.bias", bias);
    ReferenceExecutor run(g, weights);
    run.run(inputs(file, "slide_rim"));
    return run.tensor("0").clone();
  };
  const Tensor coarse = file.tensor("coarse").to(DType::kF64);
  const Tensor unchanged = matte(0);
  for (std::size_t i = 0; i < static_cast<std::size_t>(coarse.count()); ++i) {
    const double wanted = std::clamp((coarse.data<double>()[i] - 1.0 / 16) * 8 / 7, 0.0, 1.0);
    REQUIRE(std::abs(unchanged.data<double>()[i] - wanted) <= 1e-14);
  }
  const Tensor none = matte(-50), all = matte(50);
  CHECK(max_abs(none) == 0);
  for (const double m : all.data<double>()) REQUIRE(m == 1);
  // By log(24), p = 0.02 of a matte of 0 becomes 0.02·24 / (0.02·24 + 0.98) = 24/73.
  const double wanted = (24.0 / 73 - 0.08) / 0.84;
  const Tensor raised = matte(std::log(24.0));
  std::size_t empty = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(coarse.count()); ++i) {
    if (coarse.data<double>()[i] != 0) continue;
    ++empty;
    REQUIRE(raised.data<double>()[i] == doctest::Approx(wanted).epsilon(1e-12));
  }
  CHECK(empty > 100);
}

TEST_CASE("with a matte the fill has no foreground where disparity's edge is inside the foreground") {
  // A red square before a blue wall whose disparity is two pixels too small all around, and its hole.
  constexpr std::int64_t kSide = 48;
  constexpr std::size_t kPlane = kSide * kSide;
  Graph g;
  const Value rgbd = g.input("rgbd", {1, 4, kSide, kSide});
  const Value d = g.input("d", {1, 1, kSide, kSide});
  const Value hole = g.input("hole", {1, 1, kSide, kSide});
  const SubjectMatte matted{g.input("clear", {1, 1, kSide, kSide}),
                            g.input("agreement", {1, 1, kSide, kSide})};
  g.output("plain", background_fill(rgbd, d, hole));
  {
    const auto scope = g.scope("matted");
    g.output("matted", background_fill(rgbd, d, hole, {.matte = matted}));
  }
  Tensor pixels = Tensor::zeros(DType::kF32, {1, 4, kSide, kSide});
  Tensor disparity = Tensor::zeros(DType::kF32, d.shape());
  Tensor mask = Tensor::zeros(DType::kF32, d.shape());
  Tensor clear = Tensor::zeros(DType::kF32, d.shape());
  Tensor agreement = Tensor::zeros(DType::kF32, d.shape());
  for (std::size_t i = 0; i < kPlane; ++i) {
    const std::size_t row = i / kSide;
    const std::size_t column = i % kSide;
    const auto square = [&](std::size_t first, std::size_t last) {
      return row >= first && row < last && column >= first && column < last;
    };
    pixels.mutable_data<float>()[square(12, 36) ? i : 2 * kPlane + i] = 1;
    clear.mutable_data<float>()[i] = square(12, 36) ? 0 : 1;
    agreement.mutable_data<float>()[i] = square(8, 40) ? 1 : 0;
    disparity.mutable_data<float>()[i] = square(14, 34) ? 0.9F : 0.1F;
    mask.mutable_data<float>()[i] = square(14, 34) && !square(20, 28) ? 1 : 0;
  }
  FastExecutor run(g, WeightMap());
  run.run({{"rgbd", pixels}, {"d", disparity}, {"hole", mask}, {"clear", clear}, {"agreement", agreement}});
  double most = 0;
  for (std::size_t i = 0; i < kPlane; ++i) {
    CHECK(run.tensor("matted").data<float>()[i] <= 1e-3);  // no red, and blue, everywhere
    CHECK(run.tensor("matted").data<float>()[2 * kPlane + i] >= 1 - 1e-3);
    most = std::max<double>(most, run.tensor("plain").data<float>()[i]);
  }
  CHECK(most >= 0.9);  // which disparity alone cannot know
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

TEST_CASE("beside what is no source a twentieth of a weight is kept") {
  Graph g;
  const Shape row{1, 1, 1, 9};
  const Value weight = g.input("weight", row);
  g.output("two", kept_beside_margin(weight, 2));
  const double weights[] = {1, 1, 1, 0.6, 0.4, 1, 1, 1, 1};
  ReferenceExecutor run(g, WeightMap());
  run.run({{"weight", Tensor::from(row, std::span<const double>(weights))}});
  for (std::size_t i = 0; i < 9; ++i) {
    CHECK(run.tensor("two").data<double>()[i] == doctest::Approx(i >= 2 && i <= 6 ? 0.05 : 1).epsilon(1e-15));
  }
  CHECK(fill_margin({1, 3, 672, 1008}) == 3);
  CHECK(fill_margin({1, 3, 4000, 3000}) == 13);
  CHECK(fill_margin({1, 1, 96, 64}) == 0);
}

TEST_CASE("with a margin hair that hangs into the background does not colour the hole") {
  // A red square before a blue wall; its hair, three pixels of the same red, has the wall's disparity.
  constexpr std::int64_t kSide = 48;
  constexpr std::size_t kPlane = kSide * kSide;
  Graph g;
  const Value rgbd = g.input("rgbd", {1, 4, kSide, kSide});
  const Value d = g.input("d", {1, 1, kSide, kSide});
  const Value hole = g.input("hole", {1, 1, kSide, kSide});
  g.output("plain", background_fill(rgbd, d, hole));
  {
    const auto scope = g.scope("off");
    g.output("off", background_fill(rgbd, d, hole, {.margin = 4}));
  }
  Tensor pixels = Tensor::zeros(DType::kF64, {1, 4, kSide, kSide});
  Tensor disparity = Tensor::zeros(DType::kF64, d.shape());
  Tensor mask = Tensor::zeros(DType::kF64, d.shape());
  for (std::size_t i = 0; i < kPlane; ++i) {
    const std::size_t row = i / kSide, column = i % kSide;
    const auto square = [&](std::size_t first, std::size_t last) {
      return row >= first && row < last && column >= first && column < last;
    };
    pixels.mutable_data<double>()[square(11, 37) ? i : 2 * kPlane + i] = 1;
    disparity.mutable_data<double>()[i] = square(14, 34) ? 0.9 : 0.1;
    mask.mutable_data<double>()[i] = square(14, 34) && !square(20, 28) ? 1 : 0;
  }
  ReferenceExecutor run(g, WeightMap());
  run.run({{"rgbd", pixels}, {"d", disparity}, {"hole", mask}});
  const auto mean_red_in_hole = [&](const char* name) {
    double sum = 0, count = 0;
    for (std::size_t i = 0; i < kPlane; ++i) {
      if (mask.data<double>()[i] == 0) continue;
      sum += run.tensor(name).data<double>()[i];
      ++count;
    }
    return sum / count;
  };
  CHECK(mean_red_in_hole("plain") > 0.99);
  CHECK(mean_red_in_hole("off") < 0.9);
}

TEST_CASE("the default networks refuse sizes they cannot take") {
  Graph g;
  const Value photo = g.input("photo", {1, 3, 64, 100});
  CHECK_THROWS_WITH_AS((void)slide_depth(photo), doctest::Contains("multiples of 32"), Error);
  CHECK_THROWS_WITH_AS((void)slide_matte(photo), doctest::Contains("multiples of 32"), Error);
  const Value odd = g.input("odd", {1, 4, 63, 64});
  const Value map = g.input("map", {1, 1, 63, 64});
  CHECK_THROWS_WITH_AS((void)slide_inpaint(odd, map, map), doctest::Contains("multiples of 8"), Error);
  const Value rgb = g.input("rgb", {1, 3, 63, 64});
  CHECK_THROWS_WITH_AS((void)slide_rim(rgb, map), doctest::Contains("multiples of 8"), Error);
}
