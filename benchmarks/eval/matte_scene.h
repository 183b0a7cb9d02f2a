#pragma once

#include <string>
#include <vector>

#include "render/camera.h"
#include "render/image.h"

namespace slide::eval {

/// A subject with a true alpha before a known background, both flat: NAME_fg.jpg (the subject's colours),
/// NAME_alpha.png and NAME_bg.jpg, of one size. The subject stands at disparity 1, the background at 0 and so
/// far that it does not move: the true view of a camera beside the photo's is known to the last pixel.
struct MatteScene {
  std::string name;
  Image foreground, alpha, background;
  Image photo;  ///< alpha F + (1 - alpha) B, in steps of 1/255 as a file would hold it
};

/// @param alpha_file  FOLDER/NAME_alpha.png
/// @throws Error(kBadInput) naming the file for one that is missing or of another size
[[nodiscard]] MatteScene read_matte_scene(const std::string& alpha_file);

/// Pixels that the subject moves by, to either side.
inline constexpr int kMatteShift = 20;

/// How far from the outline a pixel is in the rim, in steps along rows and columns.
inline constexpr int kRimWidth = 24;

/// The camera, and the view in which the subject moves by `shift` pixels to the right.
[[nodiscard]] Camera matte_camera(const MatteScene& scene);
[[nodiscard]] View matte_view(const MatteScene& scene, int shift);

/// What that view shows.
[[nodiscard]] Image true_view(const MatteScene& scene, int shift);

/// 1 where a pixel lies within kRimWidth of the outline, in the photo.
[[nodiscard]] Image rim(const MatteScene& scene);

/// The same in the photo or the view, without the columns that the subject may enter or leave the picture by.
[[nodiscard]] Image rim_of_view(const MatteScene& scene, int shift);

/// 1 where the subject is whole: alpha at least 0.999 for 4 steps along rows and columns around.
[[nodiscard]] Image core(const MatteScene& scene);

/// A network's disparity as the scene's: the median of what is surely background becomes 0, that of what is
/// surely subject 1, and outside the rim the truth stands in: a network knows no scale, and what is judged
/// is its outline.
[[nodiscard]] Image fitted_disparity(const MatteScene& scene, const Image& disparity);

/// [alpha > 1/2]
[[nodiscard]] Image true_disparity(const MatteScene& scene);

}  // namespace slide::eval
