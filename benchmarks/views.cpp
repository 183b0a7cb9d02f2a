// slide_views: how close a rendered view comes to a photo taken from there. For rectified stereo pairs with
// measured disparity the right view is rendered from the left picture as a single layer, with hard layers and
// with soft ones, and compared with the right picture. What is compared where is said in docs/views.md.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <numeric>

#include "benchmarks/image_metrics.h"
#include "benchmarks/stereo_scene.h"
#include "examples/network_files.h"
#include "graphs/slide.h"
#include "graphs/stages.h"
#include "render/photo_layers.h"
#include "render/view.h"
#include "render/write_image.h"
#include "runtime/error.h"
#include "runtime/fast_executor.h"

namespace {

using namespace slide;

/// Ignored at each side of the picture, of its width and height.
constexpr double kBorder = 0.2;

struct Arguments {
  std::string scenes, out, depth_weights, inpaint_weights;
  graphs::LayeringParams layering;
  bool json = false;
};

/// One way to make the view, and how close it came.
struct Entry {
  std::string method;
  double psnr_visible, ssim_visible;  ///< what the left picture shows too
  double psnr_hidden;                 ///< what it does not
  double psnr_all, ssim_all;
  Image view;
};

struct SceneResult {
  StereoScene scene;
  Image hidden;
  double visible_fraction, hidden_fraction;  ///< of the pixels inside the border
  std::vector<Entry> entries;
};

/// What all methods of a scene share.
class Judge {
 public:
  explicit Judge(const StereoScene& scene) : right_(scene.right) {
    const SeenFromRight seen = seen_from_right(scene);
    visible_ = without_border(seen.visible, kBorder);
    hidden_ = without_border(seen.disoccluded, kBorder);
    all_ = visible_;
    for (std::size_t i = 0; i < all_.data.size(); ++i) all_.data[i] = std::max(all_.data[i], hidden_.data[i]);
  }
  [[nodiscard]] Entry judge(const std::string& method, Image view) const {
    return {method,
            psnr(view, right_, visible_),
            ssim(view, right_, visible_),
            psnr(view, right_, hidden_),
            psnr(view, right_, all_),
            ssim(view, right_, all_),
            std::move(view)};
  }
  [[nodiscard]] const Image& visible() const noexcept { return visible_; }
  [[nodiscard]] const Image& hidden() const noexcept { return hidden_; }

 private:
  const Image& right_;
  Image visible_, hidden_, all_;
};

Image render_right(const Layers& layers, const PixelRange& pixels) {
  const StereoView v = stereo_view(layers.foreground.colour.width, layers.foreground.colour.height, pixels);
  ViewRenderer renderer(layers, v.camera);
  Image out;
  renderer.render(v.view, {}, out);
  return out;
}

/// The foreground alone, opaque: what lies behind an edge is the triangles stretched across it.
Layers single_layer(const graphs::SlideLayers& made) {
  Layers layers = layers_from(made);
  layers.foreground.alpha = Image();
  layers.background.reset();
  return layers;
}

/// A is 0 or 1, and so is S: in the whole hole the background is what the inpainting says.
Layers hard_layers(const graphs::SlideLayers& made, const graphs::NetworkChoice& inpaint) {
  Layers layers = layers_from(made);
  if (!made.has_background()) return layers;
  for (float& a : layers.foreground.alpha.data) a = a < 0.5F ? 0.0F : 1.0F;
  Graph g;
  const Shape map = made.hole.shape();
  const graphs::Background b =
      graphs::inpaint_background(g.input("I", map.with(1, 3)), g.input("D1", map), g.input("S", map),
                                 g.input("H", map), inpaint, {.margin = graphs::fill_margin(map)});
  g.output("I_bg", b.image);
  g.output("D_bg", b.disparity);
  const WeightMap none("no weights");
  FastExecutor run(g, inpaint.chosen() ? *inpaint.weights : static_cast<const WeightSource&>(none));
  run.run({{"I", made.image}, {"D1", made.conditioned}, {"S", made.hole}, {"H", made.hole}});
  layers.background = Layer{image_from_tensor(run.tensor("I_bg")), image_from_tensor(run.tensor("D_bg")), {}};
  return layers;
}

/// The background as the plainest copy there is: a run of hole pixels in a row takes over colour and
/// disparity of the farther one of the two pixels at its ends.
void copy_background(graphs::SlideLayers& made) {
  if (!made.has_background()) return;
  Image colour = image_from_tensor(made.image);
  Image disparity = image_from_tensor(made.conditioned);
  const Image hole = image_from_tensor(made.hole);
  for (int y = 0; y < hole.height; ++y)
    for (int x = 0; x < hole.width; ++x) {
      if (!(hole.at(x, y) > 0)) continue;
      int end = x;
      while (end < hole.width && hole.at(end, y) > 0) ++end;
      const int left = std::max(0, x - 1);
      const int right = std::min(end, hole.width - 1);
      const int from = disparity.at(left, y) < disparity.at(right, y) ? left : right;
      for (; x < end; ++x) {
        for (int c = 0; c < 3; ++c) colour.at(x, y, c) = colour.at(from, y, c);
        disparity.at(x, y) = std::min(disparity.at(x, y), disparity.at(from, y));
      }
    }
  made.background_image = tensor_from_image(colour);
  made.background_disparity = tensor_from_image(disparity);
}

/// base and range such that base + range·D is closest to the known disparities (least squares).
PixelRange fit(const Image& d, const StereoScene& scene) {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (std::size_t i = 0; i < d.data.size(); ++i) {
    if (!(scene.known.data[i] > 0)) continue;
    const double p = static_cast<double>(d.data[i]);
    const double q = static_cast<double>(scene.disparity.data[i]);
    n += 1, x += p, y += q, xx += p * p, xy += p * q;
  }
  const double variance = xx / n - x / n * (x / n);
  const double range = variance > 0 ? std::max(0.0, (xy / n - x / n * (y / n)) / variance) : 0.0;
  return {y / n - range * (x / n), range};
}

class Maker {
 public:
  Maker(const Arguments& a, const StereoScene& scene) : arguments_(a), scene_(scene) {}

  /// Layers from the disparity (empty: the depth network's) for a view that is `parallax` pixels away.
  [[nodiscard]] graphs::SlideLayers make(const Tensor& disparity, double parallax,
                                         const graphs::SlideModels& models) const {
    graphs::SlideOptions options;
    options.layering = arguments_.layering;
    options.layering.parallax = parallax;
    options.whole_image = true;
    return make_layers({tensor_from_image(scene_.left), disparity, {}}, models, options);
  }

 private:
  const Arguments& arguments_;
  const StereoScene& scene_;
};

/// With the measured disparity: every way of layering, filled and inpainted.
void with_given_disparity(const Maker& maker, const graphs::SlideModels& models, const Judge& judge,
                          SceneResult& result) {
  const auto [low, high] = std::ranges::minmax(result.scene.disparity.data);
  const PixelRange pixels{static_cast<double>(low), static_cast<double>(high - low)};
  const Tensor disparity = tensor_from_image(result.scene.disparity);
  const auto add = [&](const std::string& method, const Layers& layers) {
    result.entries.push_back(judge.judge(method, render_right(layers, pixels)));
  };
  const graphs::SlideLayers filled = maker.make(disparity, pixels.range, graphs::SlideModels());
  add("single layer", single_layer(filled));
  add("hard, fill", hard_layers(filled, {}));
  add("soft, fill", layers_from(filled));
  graphs::SlideLayers copied = filled;
  copy_background(copied);
  add("soft, row copy", layers_from(copied));
  if (!models.inpaint.chosen()) return;
  graphs::SlideModels inpainting;
  inpainting.inpaint = models.inpaint;
  const graphs::SlideLayers inpainted = maker.make(disparity, pixels.range, inpainting);
  add("hard, network", hard_layers(inpainted, models.inpaint));
  add("soft, network", layers_from(inpainted));
}

/// With the depth network's disparity, scale and shift fitted to the measured one.
void with_own_depth(const Maker& maker, const graphs::SlideModels& models, const Judge& judge,
                    SceneResult& result) {
  const Image d = image_from_tensor(maker.make({}, 0, models).disparity);
  const PixelRange pixels = fit(d, result.scene);
  const graphs::SlideLayers made = maker.make(tensor_from_image(d), pixels.range, models);
  result.entries.push_back(judge.judge("own depth, single layer", render_right(single_layer(made), pixels)));
  result.entries.push_back(judge.judge("own depth, soft", render_right(layers_from(made), pixels)));
}

SceneResult run_scene(const std::string& folder, const Arguments& a, const graphs::SlideModels& models) {
  SceneResult result{read_stereo_scene(folder), {}, 0, 0, {}};
  const StereoScene& scene = result.scene;
  const Judge judge(scene);
  const double inside = (1 - 2 * kBorder) * (1 - 2 * kBorder);
  result.hidden = judge.hidden();
  result.visible_fraction = mask_fraction(judge.visible()) / inside;
  result.hidden_fraction = mask_fraction(judge.hidden()) / inside;
  const Maker maker(a, scene);
  Layers plane{{scene.left, Image(scene.left.width, scene.left.height, 1), {}}, {}};
  const double mean =
      static_cast<double>(std::reduce(scene.disparity.data.begin(), scene.disparity.data.end())) /
      static_cast<double>(scene.disparity.data.size());
  result.entries.push_back(judge.judge("one plane", render_right(plane, {mean, 0})));
  with_given_disparity(maker, models, judge, result);
  if (models.depth.chosen()) with_own_depth(maker, models, judge, result);
  return result;
}

/// The part of the picture with most hidden pixels.
struct Corner {
  int x, y;
};
Corner richest(const Image& hidden, int width, int height) {
  Corner best{0, 0};
  double most = -1;
  for (int y = 0; y + height <= hidden.height; y += 8)
    for (int x = 0; x + width <= hidden.width; x += 8) {
      double count = 0;
      for (int v = y; v < y + height; ++v)
        for (int u = x; u < x + width; ++u) count += static_cast<double>(hidden.at(u, v));
      if (count > most) most = count, best = {x, y};
    }
  return best;
}

/// Cut-outs of the truth and of every method, side by side.
void write_pictures(const std::string& folder, const SceneResult& r) {
  std::filesystem::create_directories(folder);
  constexpr int kWidth = 144;
  constexpr int kHeight = 144;
  const Corner corner = richest(r.hidden, kWidth, kHeight);
  std::vector<const Image*> views = {&r.scene.right};
  for (const Entry& e : r.entries) {
    views.push_back(&e.view);
    std::string name = e.method;
    std::erase(name, ',');
    std::ranges::replace(name, ' ', '_');
    write_png(folder + "/" + r.scene.name + "_" + name + ".png", e.view);
  }
  Image strip(kWidth * static_cast<int>(views.size()), kHeight, 3);
  for (std::size_t i = 0; i < views.size(); ++i)
    for (int y = 0; y < kHeight; ++y)
      std::copy_n(views[i]->data.data() + views[i]->index(corner.x, corner.y + y), 3 * kWidth,
                  strip.data.data() + strip.index(kWidth * static_cast<int>(i), y));
  write_jpeg(folder + "/" + r.scene.name + ".jpg", strip, 90);
}

void print(const SceneResult& r) {
  std::printf("\n%s: %.1f %% visible, %.1f %% disoccluded\n%-26s %8s %8s %8s %8s %8s\n", r.scene.name.c_str(),
              100 * r.visible_fraction, 100 * r.hidden_fraction, "", "PSNR", "SSIM", "PSNR vis", "SSIM vis",
              "PSNR new");
  for (const Entry& e : r.entries)
    std::printf("%-26s %8.2f %8.4f %8.2f %8.4f %8.2f\n", e.method.c_str(), e.psnr_all, e.ssim_all,
                e.psnr_visible, e.ssim_visible, e.psnr_hidden);
}

nlohmann::json to_json(const SceneResult& r) {
  nlohmann::json methods;
  for (const Entry& e : r.entries)
    methods[e.method] = {{"psnr", e.psnr_all},
                         {"ssim", e.ssim_all},
                         {"psnr_visible", e.psnr_visible},
                         {"ssim_visible", e.ssim_visible},
                         {"psnr_disoccluded", e.psnr_hidden}};
  return {{"scene", r.scene.name},
          {"visible", r.visible_fraction},
          {"disoccluded", r.hidden_fraction},
          {"methods", methods}};
}

std::vector<std::string> scene_folders(const std::string& folder) {
  std::vector<std::string> found;
  std::error_code failure;
  for (const auto& entry : std::filesystem::directory_iterator(folder, failure))
    if (std::filesystem::exists(entry.path() / "scene.json")) found.push_back(entry.path().string());
  if (found.empty()) throw Error(ErrorKind::kBadInput, folder + ": no folder in it holds a scene.json");
  std::ranges::sort(found);
  return found;
}

int run(CLI::App& app, int argc, char** argv) {
  Arguments a;
  app.add_option("SCENES_DIR", a.scenes, "folder of stereo scenes, each a folder with scene.json")
      ->required();
  app.add_option("--out", a.out, "write the views and a strip of cut-outs of each scene here");
  app.add_flag("--json", a.json, "print JSON");
  app.add_option("--depth-weights", a.depth_weights, "weights of the depth network; default: built in");
  app.add_option("--inpaint-weights", a.inpaint_weights,
                 "weights of the inpainting network; default: built in");
  app.add_option("--beta", a.layering.beta, "steepness of the visibility; default P^2/12");
  app.add_option("--sigma", a.layering.sigma, "conditioning blur, pixels")->capture_default_str();
  app.add_option("--maxpool", a.layering.maxpool, "side of the conditioning max-pool")->capture_default_str();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : exit_code(ErrorKind::kUsage);
  }
  NetworkFiles files;
  graphs::SlideModels models;
  models.depth = files.open(a.depth_weights, "", "slide_depth", "depth");
  models.inpaint = files.open(a.inpaint_weights, "", "slide_inpaint", "inpaint");
  nlohmann::json all = nlohmann::json::array();
  for (const std::string& folder : scene_folders(a.scenes)) {
    const SceneResult result = run_scene(folder, a, models);
    if (a.json)
      all.push_back(to_json(result));
    else
      print(result);
    if (!a.out.empty()) write_pictures(a.out, result);
  }
  if (a.json) std::cout << all.dump(1) << "\n";
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    CLI::App app(
        "Renders the right view of stereo pairs from the left picture and compares it with the truth.");
    return run(app, argc, argv);
  } catch (const Error& e) {
    std::cerr << "slide_views: " << e.what() << "\n";
    return exit_code(e.kind());
  } catch (const std::exception& e) {
    std::cerr << "slide_views: internal error: " << e.what() << "\n";
    return exit_code(ErrorKind::kInternal);
  }
}
