#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "render/camera.h"
#include "render/layers.h"

namespace slide {

/// What depth the model has.
enum class GlbDepth {
  /// A shallow relief. Depth runs from 1 to 1.3 with the same order, and the photo is seen at 40 degrees on
  /// its longer side, so that a viewer that looks from anywhere near the front shows the photo. The plane of
  /// `focus` lies at the origin and is one unit long.
  kRelief,
  /// The scene's: the camera's own depths and units, the camera at the origin. Seen from elsewhere it is a
  /// funnel, as everything that one photo shows is.
  kTrue,
};

struct GltfOptions {
  /// How far the merged mesh may displace a point, in pixels of the photo, when seen with `parallax` pixels
  /// of parallax; 0 keeps every vertex. A quarter of a pixel makes files of a few megabytes.
  double mesh_tolerance = 0.25;
  /// The parallax that the tolerance speaks of; 0 means 4 % of the photo's width.
  double parallax = 0;
  GlbDepth depth = GlbDepth::kRelief;
  double focus = 0.5;  ///< the disparity that lies at a relief's origin
};

/// The 3D photo as a binary glTF 2.0 file: one textured mesh per layer, unlit (KHR_materials_unlit, with
/// plain materials for viewers without it), and a camera that sees the photo as it was taken. glTF's axes: x
/// to the right, y up, the camera looking along -z.
///
/// The foreground's material has alphaMode BLEND and its texture (PNG) carries the visibility A. Viewers that
/// blend draw such a mesh without depth writes, so its triangles are sorted from far to near as seen from the
/// photo's camera. The background is opaque (JPEG). A single layer without alpha is opaque, too.
/// @throws Error(kBadInput) for layers that check_layers refuses
[[nodiscard]] std::vector<std::uint8_t> encode_glb(const Layers& layers, const Camera& camera,
                                                   const GltfOptions& options = {});

/// The same into a file that appears when it is complete.
void write_glb(const std::string& path, const Layers& layers, const Camera& camera,
               const GltfOptions& options = {});

}  // namespace slide
