#include "graphs/pipeline.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <thread>
#include <vector>

#include "graphs/formula_weights.h"
#include "runtime/error.h"
#include "runtime/thread_scope.h"
#include "tests/quick.h"

using namespace slide;
using slide::test::quick;
using namespace slide::graphs;

namespace {

/// A textured photo that depends on `seed`.
Tensor photo(std::int64_t height, std::int64_t width, int seed) {
  Tensor image(DType::kF32, {1, 3, height, width});
  const std::span<float> rgb = image.mutable_data<float>();
  for (std::size_t i = 0; i < rgb.size(); ++i)
    rgb[i] = 0.5F + 0.4F * std::sin(0.011F * static_cast<float>(i) * static_cast<float>(seed + 1));
  return image;
}

SlideModels all_networks(const WeightSource& weights) {
  SlideModels models;
  models.depth = {"slide_depth", &weights, 64};
  models.inpaint = {"slide_inpaint", &weights};
  models.saliency = {"slide_matte", &weights};
  return models;
}

SlideOptions options_of(double parallax) {
  SlideOptions options;
  options.layering.parallax = parallax;
  options.matte = MatteUse::kAlways;
  return options;
}

bool same_bytes(const Tensor& a, const Tensor& b) {
  return a.shape() == b.shape() && std::ranges::equal(a.raw(), b.raw());
}

const StageReport& stage(const SlideLayers& made, const std::string& name) {
  const auto found = std::ranges::find(made.report.stages, name, [](const StageReport& s) { return s.name; });
  REQUIRE(found != made.report.stages.end());
  return *found;
}

}  // namespace

TEST_CASE("a pipeline gives photo after photo the bytes that each has alone") {
  const FormulaWeights weights = FormulaWeights::made_up();
  const SlideModels models = all_networks(weights);
  Pipeline pipeline(models);
  int reused = 0;
  // Sizes come back, and with other parallaxes, so that what must not be kept differs.
  struct Case {
    std::int64_t height, width;
    double parallax;
  };
  std::vector<Case> cases = {{48, 64, 5}, {48, 64, 9}, {64, 48, 5}, {64, 48, 2}, {48, 64, 5}};
  if (quick()) cases.resize(2);
  for (const Case& c : cases) {
    CAPTURE(c.height);
    CAPTURE(c.parallax);
    const SlideInput input{photo(c.height, c.width, static_cast<int>(c.parallax)), {}, {}};
    const SlideLayers alone = make_layers(input, models, options_of(c.parallax));
    const SlideLayers made = pipeline.make_layers(input, options_of(c.parallax));
    CHECK(same_bytes(made.disparity, alone.disparity));
    CHECK(same_bytes(made.matte, alone.matte));
    CHECK(same_bytes(made.hole, alone.hole));
    CHECK(same_bytes(made.front_image, alone.front_image));
    REQUIRE(made.has_background() == alone.has_background());
    if (made.has_background()) {
      CHECK(same_bytes(made.background_image, alone.background_image));
      CHECK(same_bytes(made.background_disparity, alone.background_disparity));
    }
    CHECK(!stage(alone, "depth").reused);
    CHECK(stage(alone, "depth").preparing > 0);
    CHECK(stage(made, "depth").gflop == doctest::Approx(stage(alone, "depth").gflop));
    CHECK(stage(made, "depth").memory == stage(alone, "depth").memory);
    reused += stage(made, "depth").reused ? 1 : 0;
    CHECK(stage(made, "depth").reused == stage(made, "saliency").reused);
  }
  CHECK(reused == (quick() ? 1 : 3));
}

TEST_CASE("a pipeline keeps as much as it may") {
  const FormulaWeights weights = FormulaWeights::made_up();
  const SlideModels models = all_networks(weights);
  Pipeline pipeline(models);
  CHECK(pipeline.kept_bytes() == 0);
  const SlideOptions options = options_of(4);
  const auto reuses = [&](std::int64_t height) {
    StageReport report;
    (void)pipeline.disparity(photo(height, 48, 3), options, &report);
    return report.reused;
  };
  CHECK(!reuses(32));
  const std::size_t one = pipeline.kept_bytes();
  CHECK(one > 0);
  CHECK(reuses(32));
  CHECK(!reuses(64));
  const std::size_t two = pipeline.kept_bytes();
  CHECK(two > one);
  CHECK(reuses(32));
  pipeline.keep(two - 1);  // the one of 64 rows was used longest ago
  CHECK(pipeline.kept_bytes() == one);
  CHECK(reuses(32));
  pipeline.keep(0);
  CHECK(pipeline.kept_bytes() == 0);
  CHECK(!reuses(32));
  CHECK(!reuses(32));
  CHECK(pipeline.kept_bytes() == 0);
}

TEST_CASE("the disparity of a pipeline is that of the layers, prepared before the first photo or by it") {
  const FormulaWeights weights = FormulaWeights::made_up();
  const SlideModels models = all_networks(weights);
  SlideOptions options = options_of(4);
  options.matte = MatteUse::kNever;
  Pipeline pipeline(models);
  pipeline.prepare_disparity(40, 56, options);
  const Tensor image = photo(40, 56, 1);
  StageReport report;
  const Tensor disparity = pipeline.disparity(image, options, &report);
  CHECK(report.reused);
  CHECK(report.preparing == 0);
  CHECK(same_bytes(disparity, make_layers({image, {}, {}}, models, options).disparity));
  pipeline.release_workspace();
  CHECK(same_bytes(pipeline.disparity(image, options), disparity));
  CHECK_THROWS_AS((void)Pipeline({}).disparity(image, options), Error);
  CHECK_THROWS_AS((void)pipeline.disparity(Tensor(DType::kF32, {1, 1, 4, 4}), options), Error);
}

TEST_CASE("two pipelines on one network's weights run at once, each with threads of its own") {
  const FormulaWeights weights = FormulaWeights::made_up();
  const SlideModels models = all_networks(weights);
  const SlideOptions options = options_of(4);
  const Tensor image = photo(48, 64, 2);
  const Tensor expected = Pipeline(models).disparity(image, options);
  std::array<bool, 2> good{};
  const auto work = [&](std::size_t i) {
    const ThreadScope threads(static_cast<int>(i) + 1);
    Pipeline own(models);
    good[i] = true;
    for (int round = 0; round < 3; ++round)
      good[i] = good[i] && same_bytes(own.disparity(image, options), expected);
  };
  std::thread other([&] { work(1); });
  work(0);
  other.join();
  CHECK(good[0]);
  CHECK(good[1]);
}
