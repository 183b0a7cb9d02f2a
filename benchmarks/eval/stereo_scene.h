#pragma once

#include <string>

#include "render/camera.h"
#include "render/image.h"

namespace slide::eval {

/// A rectified stereo pair with the left picture's disparity: left(x, y) = right(x - d, y).
struct StereoScene {
  std::string name;  ///< of its folder
  Image left;        ///< H×W×3, [0, 1]
  Image right;
  Image disparity;  ///< H×W×1, pixels, > 0; unknown pixels filled, see read_stereo_scene()
  Image known;      ///< H×W×1: 1 where the disparity was measured
};

/// Reads a folder with scene.json, which names the pictures and says what a unit of the disparity file is
/// (disparity_scale pixels) and which value stands for "unknown".
///
/// An unknown disparity becomes the smaller one of the nearest known ones to the left and to the right in its
/// row: what stereo cannot match is nearly always background that one eye does not see. A row without any
/// takes over the row above (or the first that has one).
/// @throws Error(kBadInput) naming the folder, for files that are missing or do not fit together
[[nodiscard]] StereoScene read_stereo_scene(const std::string& folder);

/// Disparity [0, 1] stands for `base` to `base + range` pixels.
struct PixelRange {
  double base;
  double range;
};

/// A camera and the view of it in which disparity D moves by exactly -(base + range·D) pixels along x:
/// identity rotation, translation along x. The depths are near = 1 and far = 2; any others would do, for with
/// 1/z = D (1/near - 1/far) + 1/far a point moves by focal·tx/z + shift, linear in D: focal·tx·(1/near -
/// 1/far) = -range and the shift makes up for the rest.
struct StereoView {
  Camera camera;
  View view;
};
[[nodiscard]] StereoView stereo_view(int width, int height, const PixelRange& pixels);

/// What the right picture shows of the left one, from the filled disparity alone; each H×W×1, 0 or 1.
/// Neighbouring pixels of a row belong to one surface if their disparities differ by at most one pixel; a
/// surface's pixels are moved, linear in between, and the nearest wins.
struct SeenFromRight {
  Image visible;      ///< a surface lands here, and the nearest one that does is known
  Image disoccluded;  ///< no surface lands here: the left picture has a known jump that opens here
};
[[nodiscard]] SeenFromRight seen_from_right(const StereoScene& scene);

}  // namespace slide::eval
