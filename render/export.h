#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "render/camera.h"
#include "render/camera_path.h"
#include "render/gltf.h"
#include "render/layers.h"
#include "render/stereo.h"

namespace slide {

/// How a 3D photo is turned into files.
struct ExportOptions {
  std::string title = "3D photo";  ///< of a page
  std::string alt;                 ///< of a page, for screen readers; empty: its title
  double parallax_percent = 4;     ///< of a page's camera, and of the two eyes of a still
  double focus = 0.5;              ///< the disparity that stands still in a page and in a still
  int width = 0;                   ///< of frames and stills; 0: the photo's. The two go together.
  int height = 0;
  /// Of animations; the views are meant to be 1/30 s apart if there is none. A GIF without it has the views
  /// that are 1/15 s apart, and one without a size at most 480 pixels a side: its frames are large.
  std::optional<double> fps;
  double mesh_tolerance = 0.1;  ///< pixels; 0: one vertex a pixel
  bool supersample = false;     ///< average 2×2 samples
  GlbDepth glb_depth = GlbDepth::kRelief;
  bool keep_edges = false;               ///< do not zoom in to hide the photo's edge
  std::function<void(double)> progress;  ///< told the part that is done; may be empty
};

/// What drawing took.
struct DrawnMeshes {
  std::size_t triangles = 0;       ///< of both layers, as drawn; 0 if nothing was drawn
  std::size_t full_triangles = 0;  ///< with one vertex a pixel
};

/// Refuses names that export_file() cannot make anything of.
/// @throws Error(kUsage) naming the extensions there are
void require_export_output(const std::string& path);

/// Whether export_file() makes a page under that name (.html, .htm).
[[nodiscard]] bool is_page_output(const std::string& path);

/// Makes a file of the layers: .html (render/html.h), .glb (render/gltf.h), .ply (render/ply.h), or the
/// frames of `views` in any form that make_frame_sink() knows.
/// @throws as require_export_output(); what the exporters throw
DrawnMeshes export_file(const std::string& path, const Layers& layers, const Camera& camera,
                        const std::vector<View>& views, const ExportOptions& options);

/// Whether export_stereo() makes a still under that name: .png, .jpg, .jpeg.
[[nodiscard]] bool is_still_output(const std::string& path);

/// Makes pictures for two eyes: a still of the first pair, or one frame of a video or animation for each, in
/// any form but .png that make_frame_sink() knows.
DrawnMeshes export_stereo(const std::string& path, StereoKind kind, const Layers& layers,
                          const Camera& camera, const std::vector<Eyes>& eyes, const ExportOptions& options);

}  // namespace slide
