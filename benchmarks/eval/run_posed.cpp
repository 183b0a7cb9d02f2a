#include <algorithm>
#include <functional>

#include "benchmarks/eval/image_metrics.h"
#include "benchmarks/eval/layerings.h"
#include "benchmarks/eval/posed_scene.h"
#include "benchmarks/eval/result.h"
#include "render/camera_path.h"
#include "render/photo_layers.h"
#include "render/view.h"

namespace slide::eval {
namespace {

/// The farthest depth over the nearest, at most: make_camera()'s limit with room for rounding.
constexpr double kLargestRange = 0.99e6;

/// A range that a camera may have, from inverse depths of disparity 1 and 0.
PosedScene::Range range_of(double nearest, double farthest) {
  const double far = std::max(farthest, nearest / kLargestRange);
  return {1 / nearest, 1 / std::min(far, nearest * (1 - 1e-6))};
}

/// The range that makes the network's disparity agree best with what is known.
PosedScene::Range fit(const Image& d, const PosedScene& scene) {
  LineFit line;
  double largest = 0;
  for (const KnownDepth& k : scene.known) {
    line.add(static_cast<double>(d.at(k.x, k.y)), k.inverse);
    largest = std::max(largest, k.inverse);
  }
  const PixelRange inverse = line.result();
  const double nearest = inverse.base + inverse.range;
  return range_of(nearest > 0 ? nearest : largest, inverse.base);
}

/// One target's way: what its methods share, and the result they are added to.
class PosedRun {
 public:
  PosedRun(const PosedScene& scene, const PosedScene::Target& target, const Settings& settings)
      : scene_(scene), target_(target), settings_(settings) {
    const Image everywhere(scene.source.width, scene.source.height, 1, 1);
    mask_ = without_border(everywhere, kBorder);
    result_ = {"posed", scene.name + " " + target.name, {}, {}, target.picture, mask_};
  }

  void still() {
    if (settings_.wants("still"))
      result_.entries.push_back(
          {"still", compare(scene_.source, target_.picture, mask_, settings_.lpips), 0, scene_.source});
  }

  /// With a depth map. Its view's coverage is the scene's: what the source does not show stays black.
  void with_given_depth() {
    const Tensor inverse = disparity_from_map(scene_.depth, DepthKind::kDepth, scene_.source.width,
                                              scene_.source.height, scene_.name);
    const auto [low, high] = std::ranges::minmax(inverse.data<float>());
    const PosedScene::Range range = range_of(static_cast<double>(high), static_cast<double>(low));
    graphs::SlideModels models;
    layers_of("given depth, ", inverse, range, models, "fill");
    models.inpaint = settings_.models.inpaint;
    if (models.inpaint.chosen()) layers_of("given depth, ", inverse, range, models, "network");
  }

  void with_own_depth() {
    if (!settings_.wants("own depth, single layer") && !settings_.wants("own depth, soft")) return;
    const TimedLayers depth =
        timed_layers({tensor_from_image(scene_.source), {}, {}}, settings_.models, settings_, 0);
    const Tensor disparity = depth.made.disparity;
    const PosedScene::Range range =
        scene_.known.empty() ? *scene_.range : fit(image_from_tensor(disparity), scene_);
    layers_of("own depth, ", disparity, range, settings_.models, "");
  }

  [[nodiscard]] SceneResult result() && { return std::move(result_); }

 private:
  void layers_of(const std::string& depth, const Tensor& disparity, const PosedScene::Range& range,
                 const graphs::SlideModels& models, const std::string& filling) {
    const std::string soft = depth + "soft" + (filling.empty() ? "" : ", " + filling);
    const std::string single = depth + "single layer";
    const bool first =
        std::ranges::none_of(result_.entries, [&](const Entry& e) { return e.method == single; });
    if (!settings_.wants(soft) && !(first && settings_.wants(single))) return;
    const Camera camera =
        make_camera(scene_.source.width, scene_.source.height, kDefaultFov, range.near, range.far);
    const View view = posed_view(camera, scene_.camera, target_.camera);
    const TimedLayers made = timed_layers({tensor_from_image(scene_.source), disparity, {}}, models,
                                          settings_, largest_parallax(camera, {view}));
    if (first) add(single, made.seconds, single_layer(made.made), camera, view);
    add(soft, made.seconds, layers_from(made.made), camera, view);
  }
  void add(const std::string& method, double seconds, const Layers& layers, const Camera& camera,
           const View& view) {
    if (!settings_.wants(method)) return;
    ViewRenderer renderer(layers, camera);
    Image out;
    Image coverage;
    renderer.render(view, {}, out, &coverage);
    std::vector<Figure> figures = compare(out, target_.picture, mask_, settings_.lpips);
    figures.push_back({"covered", mask_fraction(cropped(coverage, kBorder))});
    result_.entries.push_back({method, std::move(figures), seconds, std::move(out)});
  }

  const PosedScene& scene_;
  const PosedScene::Target& target_;
  const Settings& settings_;
  Image mask_;
  SceneResult result_;
};

}  // namespace

std::vector<SceneResult> run_posed(const std::string& folder, const Settings& settings) {
  const PosedScene scene = read_posed_scene(folder);
  std::vector<SceneResult> results;
  for (const PosedScene::Target& target : scene.targets) {
    PosedRun run(scene, target, settings);
    run.still();
    if (!scene.depth.empty()) run.with_given_depth();
    if (settings.models.depth.chosen()) run.with_own_depth();
    results.push_back(std::move(run).result());
  }
  return results;
}

}  // namespace slide::eval
