#include <algorithm>
#include <functional>
#include <numeric>

#include "benchmarks/eval/image_metrics.h"
#include "benchmarks/eval/layerings.h"
#include "benchmarks/eval/result.h"
#include "benchmarks/eval/stereo_scene.h"
#include "render/photo_layers.h"
#include "render/view.h"

namespace slide::eval {
namespace {

Image render_right(const Layers& layers, const PixelRange& pixels) {
  const StereoView v = stereo_view(layers.foreground.colour.width, layers.foreground.colour.height, pixels);
  ViewRenderer renderer(layers, v.camera);
  Image out;
  renderer.render(v.view, {}, out);
  return out;
}

/// base and range such that base + range·D is closest to the known disparities.
PixelRange fit(const Image& d, const StereoScene& scene) {
  LineFit line;
  for (std::size_t i = 0; i < d.data.size(); ++i)
    if (scene.known.data[i] > 0)
      line.add(static_cast<double>(d.data[i]), static_cast<double>(scene.disparity.data[i]));
  return line.result();
}

/// One scene's way: what its methods share, and the result they are added to.
class StereoRun {
 public:
  StereoRun(StereoScene scene, const Settings& settings) : scene_(std::move(scene)), settings_(settings) {
    const SeenFromRight seen = seen_from_right(scene_);
    visible_ = without_border(seen.visible, kBorder);
    hidden_ = without_border(seen.disoccluded, kBorder);
    all_ = visible_;
    for (std::size_t i = 0; i < all_.data.size(); ++i) all_.data[i] = std::max(all_.data[i], hidden_.data[i]);
    const double inside = (1 - 2 * kBorder) * (1 - 2 * kBorder);
    result_ = {
        "stereo",
        scene_.name,
        {{"visible", mask_fraction(visible_) / inside}, {"disoccluded", mask_fraction(hidden_) / inside}},
        {},
        scene_.right,
        hidden_};
  }

  void one_plane() {
    const Layers plane{{scene_.left, Image(scene_.left.width, scene_.left.height, 1), {}}, {}};
    const double sum =
        static_cast<double>(std::reduce(scene_.disparity.data.begin(), scene_.disparity.data.end()));
    add("one plane", 0, {sum / static_cast<double>(scene_.disparity.data.size()), 0}, [&] { return plane; });
  }

  /// With the measured disparity: every way of layering, filled and inpainted.
  void with_given_disparity() {
    const auto [low, high] = std::ranges::minmax(scene_.disparity.data);
    const PixelRange pixels{static_cast<double>(low), static_cast<double>(high - low)};
    const Tensor disparity = tensor_from_image(scene_.disparity);
    const TimedLayers filled = make(disparity, pixels.range, graphs::SlideModels());
    add("single layer", filled.seconds, pixels, [&] { return single_layer(filled.made); });
    add("hard, fill", filled.seconds, pixels, [&] { return hard_layers(filled.made, {}); });
    add("soft, fill", filled.seconds, pixels, [&] { return layers_from(filled.made); });
    add("soft, row copy", filled.seconds, pixels, [&] {
      graphs::SlideLayers copied = filled.made;
      copy_background(copied);
      return layers_from(copied);
    });
    const graphs::NetworkChoice& network = settings_.models.inpaint;
    if (!network.chosen() || !(settings_.wants("hard, network") || settings_.wants("soft, network"))) return;
    graphs::SlideModels inpainting;
    inpainting.inpaint = network;
    const TimedLayers inpainted = make(disparity, pixels.range, inpainting);
    add("hard, network", inpainted.seconds, pixels, [&] { return hard_layers(inpainted.made, network); });
    add("soft, network", inpainted.seconds, pixels, [&] { return layers_from(inpainted.made); });
  }

  /// With the depth network's disparity, scale and shift fitted to the measured one.
  void with_own_depth() {
    if (!settings_.wants("own depth, single layer") && !settings_.wants("own depth, soft")) return;
    const Image d = image_from_tensor(make({}, 0, settings_.models).made.disparity);
    const PixelRange pixels = fit(d, scene_);
    const TimedLayers own = make(tensor_from_image(d), pixels.range, settings_.models);
    add("own depth, single layer", own.seconds, pixels, [&] { return single_layer(own.made); });
    add("own depth, soft", own.seconds, pixels, [&] { return layers_from(own.made); });
  }

  [[nodiscard]] SceneResult result() && { return std::move(result_); }

 private:
  [[nodiscard]] TimedLayers make(const Tensor& disparity, double parallax,
                                 const graphs::SlideModels& models) const {
    return timed_layers({tensor_from_image(scene_.left), disparity, {}}, models, settings_, parallax);
  }
  void add(const std::string& method, double seconds, const PixelRange& pixels,
           const std::function<Layers()>& layers) {
    if (!settings_.wants(method)) return;
    Image view = render_right(layers(), pixels);
    std::vector<Figure> figures = compare(view, scene_.right, all_, settings_.lpips);
    figures.push_back({"psnr_visible", psnr(view, scene_.right, visible_)});
    figures.push_back({"ssim_visible", ssim(view, scene_.right, visible_)});
    figures.push_back({"psnr_disoccluded", psnr(view, scene_.right, hidden_)});
    result_.entries.push_back({method, std::move(figures), seconds, std::move(view)});
  }

  StereoScene scene_;
  const Settings& settings_;
  Image visible_, hidden_, all_;
  SceneResult result_;
};

}  // namespace

SceneResult run_stereo(const std::string& folder, const Settings& settings) {
  StereoRun run(read_stereo_scene(folder), settings);
  run.one_plane();
  run.with_given_disparity();
  if (settings.models.depth.chosen()) run.with_own_depth();
  return std::move(run).result();
}

}  // namespace slide::eval
