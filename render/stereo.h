#pragma once

#include <string>

#include "render/image.h"

namespace slide {

/// Two views, left and right eye, in one picture. Both have 3 channels and one size, else Error(kInternal).

/// The left view beside the right one: 2W×H, for parallel viewing and headsets.
[[nodiscard]] Image side_by_side(const Image& left, const Image& right);

/// The left view above the right one: W×2H.
[[nodiscard]] Image top_bottom(const Image& left, const Image& right);

/// Pairs of columns (rows) averaged; the last one of an odd number stays alone. 3D television sets and
/// players enlarge such halves again.
[[nodiscard]] Image half_width(const Image& view);
[[nodiscard]] Image half_height(const Image& view);

/// One picture for red-cyan glasses: Dubois' least-squares projection ("A projection method to generate
/// anaglyph stereo images", ICASSP 2001; his matrices for red and cyan), applied in linear light and clipped.
[[nodiscard]] Image anaglyph(const Image& left, const Image& right);

enum class StereoKind {
  kSideBySide,      ///< "sbs": side_by_side()
  kHalfSideBySide,  ///< "half-sbs": of halves, the size of one view
  kCrossEyed,       ///< "cross": the right view on the left, for eyes that cross
  kTopBottom,       ///< "tb": top_bottom()
  kHalfTopBottom,   ///< "half-tb": of halves, the size of one view
  kAnaglyph,        ///< "anaglyph"
};
/// @throws Error(kUsage) for another name than those above
[[nodiscard]] StereoKind stereo_kind(const std::string& name);

/// The two views in one picture of that kind.
[[nodiscard]] Image stereo_picture(StereoKind kind, const Image& left, const Image& right);

}  // namespace slide
