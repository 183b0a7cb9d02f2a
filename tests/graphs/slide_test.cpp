#include "graphs/slide.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "graphs/formula_weights.h"
#include "graphs/stages.h"
#include "ops/fusion/fusion.h"
#include "runtime/error.h"
#include "runtime/fast_executor.h"
#include "runtime/reference_executor.h"

using namespace slide;
using namespace slide::graphs;

namespace {

/// A textured wall with discs in front of it.
struct Scene {
  Scene(std::int64_t height, std::int64_t width, std::vector<std::array<std::int64_t, 3>> discs)
      : image(DType::kF32, {1, 3, height, width}),
        disparity(Tensor::zeros(DType::kF32, {1, 1, height, width})) {
    const std::span<float> rgb = image.mutable_data<float>();
    const std::span<float> d = disparity.mutable_data<float>();
    const std::size_t plane = static_cast<std::size_t>(height * width);
    for (std::int64_t y = 0; y < height; ++y)
      for (std::int64_t x = 0; x < width; ++x) {
        const std::size_t i = static_cast<std::size_t>(y * width + x);
        d[i] = 0.1F * static_cast<float>(y) / static_cast<float>(height);
        for (const auto& [cx, cy, r] : discs)
          if ((x - cx) * (x - cx) + (y - cy) * (y - cy) < r * r) d[i] = 1;
        for (std::size_t c = 0; c < 3; ++c)
          rgb[c * plane + i] = 0.5F + 0.4F * std::sin(0.3F * static_cast<float>(x) +
                                                      0.2F * static_cast<float>(y) + static_cast<float>(c));
      }
  }
  Tensor image, disparity;
};

SlideModels inpainting(const WeightSource& weights, const std::string& model) {
  SlideModels models;
  models.inpaint = {model, &weights};
  return models;
}

SlideOptions with_parallax(double parallax) {
  SlideOptions options;
  options.layering.parallax = parallax;
  return options;
}

}  // namespace

TEST_CASE("windows with the receptive radius give the bytes of the whole image inside the hole") {
  // The discs are far apart; the coarse network's radius of 152 pixels leaves a part of the image out.
  const Scene scene(64, 700, {{40, 30, 12}, {640, 30, 14}});
  const FormulaWeights weights = FormulaWeights::made_up();
  const SlideModels models = inpainting(weights, "inpaint_coarse");
  SlideOptions options = with_parallax(8);
  const SlideInput input{scene.image, scene.disparity, {}};
  const SlideLayers windows = make_layers(input, models, options);
  options.whole_image = true;
  const SlideLayers whole = make_layers(input, models, options);
  CHECK(windows.report.windows.size() == 2);
  CHECK(windows.report.windows_exact);
  CHECK(windows.report.window_fraction < 0.9);
  CHECK(whole.report.windows.size() == 1);
  CHECK(whole.report.window_fraction == 1.0);
  // Kernels may add up in another order at another size, so the networks' results agree to rounding.
  CHECK(max_abs_difference(windows.background_image, whole.background_image) < 1e-5);
  CHECK(max_abs_difference(windows.background_disparity, whole.background_disparity) < 1e-5);
}

TEST_CASE("the fill's reach is not limited; what its windows change is small") {
  const Scene scene(64, 500, {{40, 30, 12}, {440, 30, 14}});
  SlideOptions options = with_parallax(8);
  const SlideInput input{scene.image, scene.disparity, {}};
  const SlideLayers windows = make_layers(input, {}, options);
  options.whole_image = true;
  const SlideLayers whole = make_layers(input, {}, options);
  CHECK(windows.report.window_fraction < 1.0);
  CHECK(!windows.report.windows_exact);
  CHECK(max_abs_difference(windows.background_image, whole.background_image) < 0.05);
}

TEST_CASE("outside the hole the background is the photo, inside it is never nearer than what covers it") {
  const Scene scene(50, 90, {{45, 25, 12}});
  const FormulaWeights weights = FormulaWeights::made_up();
  const SlideLayers made =
      make_layers({scene.image, scene.disparity, {}}, inpainting(weights, "slide_inpaint"), with_parallax(6));
  REQUIRE(made.has_background());
  const auto hole = made.hole.data<float>();
  const auto image = made.image.data<float>();
  const auto behind = made.background_image.data<float>();
  std::size_t changed = 0;
  for (std::size_t i = 0; i < hole.size(); ++i) {
    REQUIRE(made.background_disparity.data<float>()[i] <= made.conditioned.data<float>()[i]);
    for (std::size_t c = 0; c < 3; ++c) {
      const std::size_t j = c * hole.size() + i;
      if (hole[i] == 0)
        REQUIRE(behind[j] == image[j]);
      else
        changed += behind[j] != image[j] ? 1 : 0;
      REQUIRE((behind[j] >= 0 && behind[j] <= 1));
    }
  }
  CHECK(changed > 0);
}

TEST_CASE("the whole as one graph gives what the stages give") {
  const Scene scene(64, 96, {{48, 32, 14}});
  const FormulaWeights weights = FormulaWeights::made_up();
  SlideModels models = inpainting(weights, "inpaint_coarse");
  models.depth = {"slide_depth", &weights};
  SlideOptions options = with_parallax(8);
  options.whole_image = true;
  const SlideLayers staged = make_layers({scene.image, {}, {}}, models, options);
  Graph g;
  const SlideGraph whole =
      slide_graph(g.input("image", scene.image.shape()), models, resolve(options.layering));
  g.output("D", whole.disparity);
  g.output("A", whole.maps.visibility);
  g.output("I_bg", whole.background_image);
  g.output("D_bg", whole.background_disparity);
  const auto fused = ops::fuse(g);
  FastExecutor run(*fused, *slide_weights(models));
  run.run({{"image", scene.image}});
  CHECK(max_abs_difference(run.tensor("D"), staged.disparity) == 0);
  CHECK(max_abs_difference(run.tensor("A"), staged.visibility) == 0);
  if (staged.has_background()) {
    CHECK(max_abs_difference(run.tensor("I_bg"), staged.background_image) == 0);
    CHECK(max_abs_difference(run.tensor("D_bg"), staged.background_disparity) == 0);
  }
  // And the same in float64, with the weights found below their scopes.
  ReferenceExecutor reference(g, *slide_weights(models));
  reference.run({{"image", scene.image}});
  CHECK(max_abs_difference(reference.tensor("D"), staged.disparity) < 1e-3);
}

TEST_CASE(
    "a given matte takes part in the inpainting: as one graph, stage by stage, and not where it is zero") {
  const Scene scene(64, 96, {{48, 32, 14}});
  Tensor matte = Tensor::zeros(DType::kF32, scene.disparity.shape());
  const SlideOptions options = [] {
    SlideOptions o = with_parallax(8);
    o.whole_image = true;
    return o;
  }();
  const FormulaWeights weights = FormulaWeights::made_up();
  for (const char* model : {"", "slide_inpaint", "inpaint_coarse"}) {
    CAPTURE(model);
    const SlideModels models = *model == 0 ? SlideModels{} : inpainting(weights, model);
    const SlideLayers plain = make_layers({scene.image, scene.disparity, {}}, models, options);
    const SlideLayers zero = make_layers(
        {scene.image, scene.disparity, Tensor::zeros(DType::kF32, matte.shape())}, models, options);
    CHECK(zero.report.matte_used);
    CHECK(zero.report.matte_in_fill == (std::string(model) != "inpaint_coarse"));
    CHECK(max_abs_difference(zero.background_image, plain.background_image) == 0);
    CHECK(max_abs_difference(zero.background_disparity, plain.background_disparity) == 0);
    // The disc and two pixels more.
    const std::span<float> m = matte.mutable_data<float>();
    for (std::int64_t y = 0; y < 64; ++y)
      for (std::int64_t x = 0; x < 96; ++x)
        m[static_cast<std::size_t>(96 * y + x)] =
            (x - 48) * (x - 48) + (y - 32) * (y - 32) < 16 * 16 ? 1.0F : 0.0F;
    const SlideLayers matted = make_layers({scene.image, scene.disparity, matte}, models, options);
    const double change = max_abs_difference(matted.background_image, plain.background_image);
    CHECK(change > 0.01);
    const auto planned = plan_layers(64, 96, models, {scene.image, scene.disparity, matte}, options);
    CHECK(planned.back().report.memory == matted.report.stages.back().memory);
  }
  SlideModels models;
  models.depth = {"slide_depth", &weights};
  SlideOptions wide = options;
  wide.layering.parallax = 60;  // for holes in what made-up weights make of a photo
  const SlideLayers staged = make_layers({scene.image, {}, matte}, models, wide);
  Graph g;
  const Value m = g.input("M", matte.shape());
  const SlideGraph whole =
      slide_graph(g.input("image", scene.image.shape()), models, resolve(wide.layering), m);
  g.output("I_bg", whole.background_image);
  const auto fused = ops::fuse(g);
  FastExecutor run(*fused, *slide_weights(models));
  run.run({{"image", scene.image}, {"M", matte}});
  REQUIRE(staged.has_background());
  CHECK(max_abs_difference(run.tensor("I_bg"), staged.background_image) == 0);
}

TEST_CASE("an estimated matte is followed beside an estimated disparity and beside a given one") {
  const Scene scene(64, 96, {{48, 32, 14}});
  const FormulaWeights weights = FormulaWeights::made_up();
  SlideModels models;
  models.depth = {"slide_depth", &weights};
  models.saliency = {"slide_matte", &weights};
  SlideOptions options = with_parallax(60);
  options.whole_image = true;
  for (const Tensor& disparity : {Tensor(), scene.disparity}) {
    options.matte = MatteUse::kAlways;
    const SlideInput input{scene.image, disparity, {}};
    const SlideLayers matted = make_layers(input, models, options);
    CHECK(matted.report.matte_used);
    CHECK(matted.report.matte_in_fill);
    const auto planned = plan_layers(64, 96, models, input, options);
    CHECK(planned[planned.size() - 3].report.name == "subject");
    CHECK(planned.back().report.memory == matted.report.stages.back().memory);
  }
}

TEST_CASE("the subject moves with its own colours, before a background without them") {
  // A red square with a soft rim before a blue wall. Its disparity ends a pixel inside the outline of alpha =
  // 1/2.
  constexpr std::int64_t kSide = 240;
  constexpr std::size_t kPlane = kSide * kSide;
  Tensor image(DType::kF32, {1, 3, kSide, kSide});
  Tensor disparity(DType::kF32, {1, 1, kSide, kSide});
  Tensor matte(DType::kF32, {1, 1, kSide, kSide});
  for (std::size_t i = 0; i < kPlane; ++i) {
    const auto inside = [&](std::size_t first) {
      const auto in = [&](std::size_t v) { return v >= first && v < kSide - first; };
      return in(i / kSide) && in(i % kSide);
    };
    const float a = inside(30) ? 1 : inside(29) ? 0.75F : inside(28) ? 0.5F : inside(27) ? 0.25F : 0;
    matte.mutable_data<float>()[i] = a;
    image.mutable_data<float>()[i] = a;
    image.mutable_data<float>()[kPlane + i] = 0;
    image.mutable_data<float>()[2 * kPlane + i] = 1 - a;
    disparity.mutable_data<float>()[i] = inside(30) ? 1 : 0;
  }
  const SlideLayers made = make_layers({image, disparity, matte}, {}, with_parallax(8));
  REQUIRE(made.has_background());
  std::size_t rim = 0;
  for (std::size_t i = 0; i < kPlane; ++i) {
    const float a = matte.data<float>()[i];
    CAPTURE(i);
    REQUIRE(std::fabs(made.visibility.data<float>()[i] - a) <= (a > 0 ? 1e-3 : 1.0));
    if (a > 0) {  // red, near
      REQUIRE(made.front_image.data<float>()[i] >= 0.95F);
      REQUIRE(made.front_image.data<float>()[2 * kPlane + i] <= 0.05F);
      REQUIRE(made.conditioned.data<float>()[i] >= 0.99F);
    }
    if (made.disocclusion.data<float>()[i] > 0.99F) {  // blue
      REQUIRE(made.background_image.data<float>()[i] <= 0.05F);
      REQUIRE(made.background_image.data<float>()[2 * kPlane + i] >= 0.95F);
    }
    if (a == 0.5F) {
      ++rim;
      REQUIRE(made.hole.data<float>()[i] == 1);
      REQUIRE(made.background_disparity.data<float>()[i] <= 0.01F);
    }
  }
  CHECK(rim == 732);  // 4·(240 - 2·28) - 4
  // A matte that shows nothing of what disparity does is not followed.
  for (float& m : matte.mutable_data<float>()) m = 1 - m;
  const SlideLayers inverted = make_layers({image, disparity, matte}, {}, with_parallax(8));
  CHECK(max_abs_difference(inverted.front_image, image) == 0);
  CHECK(max_abs_difference(inverted.disparity, disparity) == 0);
}

TEST_CASE("no relief: one layer; no parallax: one layer; nothing is inpainted") {
  const Scene flat(40, 60, {});
  const Tensor constant = Tensor::zeros(DType::kF32, {1, 1, 40, 60});
  const SlideLayers one = make_layers({flat.image, constant, {}}, {}, with_parallax(8));
  CHECK(!one.report.relief);
  CHECK(!one.has_background());
  const Scene disc(40, 60, {{30, 20, 9}});
  const SlideLayers still = make_layers({disc.image, disc.disparity, {}}, {}, with_parallax(0));
  CHECK(still.report.relief);
  CHECK(!still.has_background());
  CHECK(still.report.hole_fraction == 0);
}

TEST_CASE("a given disparity of any range is normalised; NaN in it is refused with its place") {
  Scene scene(40, 60, {{30, 20, 9}});
  for (float& v : scene.disparity.mutable_data<float>()) v = 300 * v - 20;
  const SlideLayers made = make_layers({scene.image, scene.disparity, {}}, {}, with_parallax(4));
  CHECK(max_abs(made.disparity) == 1.0);
  scene.disparity.mutable_data<float>()[2 * 60 + 5] = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_WITH_AS((void)make_layers({scene.image, scene.disparity, {}}, {}, with_parallax(4)),
                       doctest::Contains("pixel (5, 2)"), Error);
}

TEST_CASE("a given map's soft edges are brought onto the photo's, sharp ones are left alone") {
  // A ramp of 8 pixels around 88, where the photo's edge is at 90; sharpened only if it is said or seen to be soft.
  constexpr std::int64_t kSide = 200;
  Tensor image(DType::kF32, {1, 3, kSide, kSide});
  Tensor soft(DType::kF32, {1, 1, kSide, kSide});
  Tensor sharp(DType::kF32, {1, 1, kSide, kSide});
  for (std::int64_t i = 0; i < kSide * kSide; ++i) {
    const auto x = static_cast<float>(i % kSide);
    for (std::int64_t c = 0; c < 3; ++c)
      image.mutable_data<float>()[static_cast<std::size_t>(c * kSide * kSide + i)] = x < 90 ? 0.2F : 0.7F;
    soft.mutable_data<float>()[static_cast<std::size_t>(i)] = 3 * std::clamp((x - 86) / 4, 0.0F, 1.0F);
    sharp.mutable_data<float>()[static_cast<std::size_t>(i)] = x < 88 ? 0.0F : 3.0F;
  }
  const auto made = [&](const Tensor& map, DepthEdges edges) {
    SlideOptions options = with_parallax(8);
    options.depth_edges = edges;
    return make_layers({image, map, {}}, {}, options);
  };
  const auto at = [](const SlideLayers& l, std::int64_t x) {
    return l.disparity.data<float>()[static_cast<std::size_t>(100 * kSide + x)];
  };
  const SlideLayers seen = made(soft, DepthEdges::kAuto);
  CHECK(seen.report.depth_sharpened);
  CHECK(seen.report.depth_jump_pixels == doctest::Approx(4).epsilon(1e-5));
  CHECK(at(seen, 89) < 0.01F);
  CHECK(at(seen, 90) > 0.99F);
  CHECK(max_abs_difference(seen.disparity, made(soft, DepthEdges::kSoft).disparity) == 0);
  CHECK(at(made(soft, DepthEdges::kSharp), 88) == doctest::Approx(0.5));
  const SlideLayers left = made(sharp, DepthEdges::kAuto);
  CHECK(!left.report.depth_sharpened);
  CHECK(at(left, 87) == 0);
  CHECK(at(left, 88) == 1);
  CHECK(made(sharp, DepthEdges::kSoft).report.depth_sharpened);
  // The plan has the stage that runs, with its memory.
  SlideOptions options = with_parallax(8);
  options.depth_edges = DepthEdges::kAuto;
  const auto planned = plan_layers(kSide, kSide, {}, {image, soft, {}}, options);
  REQUIRE(planned.front().report.name == "depth");
  CHECK(planned.front().report.memory == seen.report.stages.front().memory);
  CHECK(plan_layers(kSide, kSide, {}, {image, sharp, {}}, options).front().report.name == "layering");
}

TEST_CASE("a plan over the memory limit is refused; a cancelled run stops") {
  const Scene scene(64, 96, {{48, 32, 14}});
  const FormulaWeights weights = FormulaWeights::made_up();
  const SlideModels models = inpainting(weights, "inpaint_coarse");
  SlideOptions options = with_parallax(8);
  options.memory_limit = 1 << 20;
  CHECK_THROWS_AS((void)make_layers({scene.image, scene.disparity, {}}, models, options), Error);
  options.memory_limit = 0;
  options.progress = [](const std::string& stage, double, std::string_view) { return stage != "inpainting"; };
  try {
    (void)make_layers({scene.image, scene.disparity, {}}, models, options);
    FAIL("not cancelled");
  } catch (const Error& e) {
    CHECK(e.kind() == ErrorKind::kCancelled);
  }
}

TEST_CASE("what is planned is what runs") {
  const Scene scene(64, 96, {{48, 32, 14}});
  const FormulaWeights weights = FormulaWeights::made_up();
  const SlideModels models = inpainting(weights, "inpaint_coarse");
  SlideOptions options = with_parallax(8);
  options.whole_image = true;
  const SlideInput input{scene.image, scene.disparity, {}};
  const auto planned = plan_layers(64, 96, models, input, options);
  const SlideLayers made = make_layers(input, models, options);
  REQUIRE(planned.size() == 2);
  REQUIRE(made.report.stages.size() == 3);  // normalising the given map is a stage of its own
  CHECK(planned[1].report.memory == made.report.stages[2].memory);
  CHECK(planned[1].report.gflop == made.report.stages[2].gflop);
}
