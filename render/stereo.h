#pragma once

#include "render/image.h"

namespace slide {

/// Two views, left and right eye, in one picture. Both have 3 channels and one size, else Error(kInternal).

/// The left view beside the right one: 2W×H, for parallel (or crossed) viewing and 3D television sets.
[[nodiscard]] Image side_by_side(const Image& left, const Image& right);

/// One picture for red-cyan glasses: Dubois' least-squares projection ("A projection method to generate
/// anaglyph stereo images", ICASSP 2001; his matrices for red and cyan), applied in linear light and clipped.
[[nodiscard]] Image anaglyph(const Image& left, const Image& right);

}  // namespace slide
