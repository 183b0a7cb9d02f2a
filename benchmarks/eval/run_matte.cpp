#include <array>
#include <cmath>

#include "benchmarks/eval/flip.h"
#include "benchmarks/eval/image_metrics.h"
#include "benchmarks/eval/layerings.h"
#include "benchmarks/eval/matte_scene.h"
#include "benchmarks/eval/result.h"
#include "render/camera_path.h"
#include "render/photo_layers.h"
#include "render/view.h"

namespace slide::eval {
namespace {

/// Of the meshes, in pixels of the photo: slide_run's default.
constexpr double kMeshTolerance = 0.1;

/// As a file of 8 bits holds it.
Image in_steps(Image image) {
  for (float& v : image.data) v = std::round(v * 255) / 255;
  return image;
}

/// Means of two views' figures.
std::vector<Figure> means(const std::vector<Figure>& a, const std::vector<Figure>& b) {
  std::vector<Figure> out = a;
  for (std::size_t i = 0; i < out.size(); ++i) out[i].value = (a[i].value + b[i].value) / 2;
  return out;
}

class MatteRun {
 public:
  MatteRun(const MatteScene& scene, const Settings& settings)
      : scene_(scene),
        settings_(settings),
        camera_(matte_camera(scene)),
        views_({matte_view(scene, kMatteShift), matte_view(scene, -kMatteShift)}),
        core_(core(scene)) {
    for (const int shift : kShifts) {
      truths_.push_back(true_view(scene, shift));
      rims_.push_back(rim_of_view(scene, shift));
    }
    result_ = {"matte", scene.name, {}, {}, truths_[0], rims_[0]};
  }

  /// The photo itself, nothing moves.
  void still() {
    if (settings_.wants("still"))
      result_.entries.push_back(
          {"still", means(judge(scene_.photo, 0), judge(scene_.photo, 1)), 0, scene_.photo});
  }
  void layers(const std::string& depth, const Image& disparity) {
    soft(depth, disparity, {}, graphs::MatteUse::kNever);
    soft(depth + ", true matte", disparity, tensor_from_image(scene_.alpha), graphs::MatteUse::kNever);
    if (settings_.models.saliency.chosen())
      soft(depth + ", auto matte", disparity, {}, graphs::MatteUse::kAuto);
  }
  [[nodiscard]] Image own_disparity() const {
    const TimedLayers depth =
        timed_layers({tensor_from_image(scene_.photo), {}, {}}, settings_.models, settings_, 0);
    return fitted_disparity(scene_, image_from_tensor(depth.made.disparity));
  }
  [[nodiscard]] SceneResult result() && { return std::move(result_); }

 private:
  static constexpr std::array kShifts = {kMatteShift, -kMatteShift};

  [[nodiscard]] std::vector<Figure> judge(const Image& view, std::size_t which) const {
    const Image& truth = truths_[which];
    const Image& rim = rims_[which];
    return {{"psnr", psnr(view, truth, rim)},
            {"ssim", ssim(view, truth, rim)},
            {"gmsd", gmsd(view, truth, rim)},
            {"gmsd_full", gmsd(view, truth, rim, GradientScale::kFull)},
            {"flip", flip(view, truth, rim)}};
  }
  void add(const std::string& method, double seconds, const Layers& layers, double seen_through) {
    if (!settings_.wants(method)) return;
    ViewRenderer renderer(layers, camera_, mesh_tolerance(camera_, views_, kMeshTolerance));
    std::vector<Image> drawn(2);
    for (std::size_t i = 0; i < 2; ++i) {
      renderer.render(views_[i], {}, drawn[i]);
      drawn[i] = in_steps(std::move(drawn[i]));
    }
    std::vector<Figure> figures = means(judge(drawn[0], 0), judge(drawn[1], 1));
    figures.push_back({"core", seen_through});
    result_.entries.push_back({method, std::move(figures), seconds, std::move(drawn[0])});
  }
  /// Soft layers, and for the plain depth a single one.
  void soft(const std::string& method, const Image& disparity, const Tensor& matte, graphs::MatteUse use) {
    const bool plain = matte.empty() && use == graphs::MatteUse::kNever;
    const std::string single = method + ", single layer";
    if (!settings_.wants(method) && !(plain && settings_.wants(single))) return;
    const TimedLayers made =
        timed_layers({tensor_from_image(scene_.photo), tensor_from_image(disparity), matte}, settings_.models,
                     settings_, largest_parallax(camera_, views_), use);
    if (plain) add(single, made.seconds, single_layer(made.made), 0);
    add(method, made.seconds, layers_from(made.made), seen_through(image_from_tensor(made.made.visibility)));
  }
  /// The share of the core with a visibility under one half.
  [[nodiscard]] double seen_through(const Image& visibility) const {
    double inside = 0;
    double below = 0;
    for (std::size_t i = 0; i < core_.data.size(); ++i) {
      if (!(core_.data[i] > 0)) continue;
      inside += 1;
      below += visibility.data[i] < 0.5F ? 1 : 0;
    }
    return below / inside;
  }

  const MatteScene& scene_;
  const Settings& settings_;
  Camera camera_;
  std::vector<View> views_;
  Image core_;
  std::vector<Image> truths_, rims_;
  SceneResult result_;
};

}  // namespace

SceneResult run_matte(const std::string& alpha_file, const Settings& settings) {
  const MatteScene scene = read_matte_scene(alpha_file);
  MatteRun run(scene, settings);
  run.still();
  run.layers("given depth", true_disparity(scene));
  if (settings.models.depth.chosen()) run.layers("own depth", run.own_disparity());
  return std::move(run).result();
}

}  // namespace slide::eval
