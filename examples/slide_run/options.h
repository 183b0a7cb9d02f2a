#pragma once

#include <CLI/CLI.hpp>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "render/camera.h"

namespace slide::run {

/// What --inpaint-model says instead of a network: the depth-aware fill alone.
inline constexpr const char* kFillAlone = "fill";
/// --matting-model: the saliency network's matte as it is.
inline constexpr const char* kMatteAsItIs = "none";

/// Everything that slide_run's command line can say. Defaults are those that --help shows.
struct Options {
  // Input
  std::vector<std::string> inputs;
  std::string depth;
  std::string depth_kind = "disparity";
  std::string depth_edges = "auto";
  std::string matte = "none";
  int max_side = 1536;

  // Networks
  std::string depth_weights, depth_model;
  int depth_size = 0;
  std::string inpaint_weights, inpaint_model;
  std::string saliency_weights, saliency_model;
  std::string matting_weights, matting_model;

  // Output
  std::vector<std::string> outputs;
  std::string stereo;
  std::string glb_depth = "relief";
  std::string title, alt;
  std::string layers;
  std::string dump_masks;

  // Camera path
  std::string path = "circle";
  double parallax = 4;
  double focus = 0.5;
  int frames = 60;
  std::optional<double> fps;
  std::string size;
  bool keep_edges = false;

  // Geometry
  double near_depth = 1;
  double far_depth = 10;
  std::optional<double> fov;

  // Layering
  std::optional<double> beta, gamma, rho;
  std::optional<int> radius;
  double sigma = 0;
  int maxpool = 3;

  // Drawing
  double mesh_tolerance = 0.1;
  bool supersample = false;

  // Running
  int threads = 0;
  std::string isa;
  std::string max_memory;
  std::string precision;
  std::optional<double> error_budget;
  bool whole_image = false;
  bool explain = false;
  bool plan = false;
  bool overwrite = false;
  bool quiet = false;
  bool json = false;

  // Help
};

/// What --depth says instead of a file: the map that the photo's own file holds, or that or the network.
inline constexpr const char* kDepthEmbedded = "embedded";
inline constexpr const char* kDepthAuto = "auto";

/// Whether --depth names a file.
[[nodiscard]] bool depth_is_file(const Options& options);

/// Declares all options on a command-line parser, grouped as the struct is.
void declare(CLI::App& app, Options& options);

/// "512M", "2G", "1500000" (bytes) as a number of bytes. @throws Error(kUsage)
[[nodiscard]] std::size_t parse_bytes(const std::string& text);

/// "1280x720", or "1280" for the longer side with the photo's shape kept; empty: the photo's own size.
/// @throws Error(kUsage)
[[nodiscard]] std::pair<int, int> parse_size(const std::string& text, int photo_width, int photo_height);

}  // namespace slide::run
