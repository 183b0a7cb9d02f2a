#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "render/camera.h"
#include "render/layers.h"

namespace slide {

/// The 3D photo as a cloud of coloured points: PLY, binary and little-endian, per vertex x, y, z (float) and
/// red, green, blue (uchar, sRGB-encoded). Axes and units are those of a GLB with the scene's own depth: x to
/// the right, y up, the camera at the origin looking along -z, distances between near and far.
///
/// One point for each pixel of the foreground that is at least half visible, row by row; then one for each
/// pixel of the background that lies elsewhere than the foreground's or where that is less than half visible.
/// @throws Error(kBadInput) for layers that check_layers refuses
[[nodiscard]] std::vector<std::uint8_t> encode_ply(const Layers& layers, const Camera& camera);

/// The same into a file that appears when it is complete.
void write_ply(const std::string& path, const Layers& layers, const Camera& camera);

}  // namespace slide
