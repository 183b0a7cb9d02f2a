#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "graphs/slide.h"
#include "render/image.h"
#include "runtime/weights.h"

namespace slide::eval {

/// Ignored at each side of the picture, of its width and height, as in the paper.
inline constexpr double kBorder = 0.2;

/// A number with its name.
struct Figure {
  std::string name;
  double value;
};

/// One way to make a view, and how close it came.
struct Entry {
  std::string method;
  std::vector<Figure> figures;
  double seconds = 0;  ///< that making the layers took
  Image view;
};

struct SceneResult {
  std::string kind;  ///< "stereo", "posed", "matte"
  std::string name;
  std::vector<Figure> facts;  ///< about the scene
  std::vector<Entry> entries;
  Image truth;
  Image interesting;  ///< H×W×1: cut-outs show where most of it is
};

/// What the layers are made with: LayeringParams, its steepnesses as multiples of what P gives.
struct LayeringChoice {
  std::optional<double> beta;   ///< of P²; the default is 1/12
  std::optional<double> gamma;  ///< of P; the default is 1
  std::optional<double> rho;    ///< of 1/P; the default is 1
  double sigma = graphs::LayeringParams().sigma;
  std::int64_t maxpool = graphs::LayeringParams().maxpool;

  [[nodiscard]] graphs::LayeringParams params(double parallax) const;
};

/// What a run is made with.
struct Settings {
  graphs::SlideModels models;
  LayeringChoice layering;
  graphs::DepthEdges depth_edges = graphs::DepthEdges::kSharp;  ///< of the scenes' own depth maps
  std::string only;                                             ///< methods whose name holds this
  const WeightSource* lpips = nullptr;                          ///< of graphs::lpips_alex(); null: without

  [[nodiscard]] bool wants(const std::string& method) const { return method.find(only) != std::string::npos; }
};

/// PSNR, SSIM, MS-SSIM, GMSD and FLIP where the mask is 1; and LPIPS, with weights, of the picture without
/// its border.
[[nodiscard]] std::vector<Figure> compare(const Image& view, const Image& truth, const Image& mask,
                                          const WeightSource* lpips);

/// LPIPS of two pictures, computed by the kernels.
[[nodiscard]] double lpips_distance(const Image& a, const Image& b, const WeightSource& weights);

/// Runs one scene. @throws as the scenes' readers, and make_layers()
[[nodiscard]] SceneResult run_stereo(const std::string& folder, const Settings& settings);
/// One result a target.
[[nodiscard]] std::vector<SceneResult> run_posed(const std::string& folder, const Settings& settings);
[[nodiscard]] SceneResult run_matte(const std::string& alpha_file, const Settings& settings);

/// Layers from a photo, and the time that took. With an empty disparity the depth network's.
struct TimedLayers {
  graphs::SlideLayers made;
  double seconds;
};
[[nodiscard]] TimedLayers timed_layers(const graphs::SlideInput& input, const graphs::SlideModels& models,
                                       const Settings& settings, double parallax,
                                       graphs::MatteUse matte = graphs::MatteUse::kNever);

}  // namespace slide::eval
