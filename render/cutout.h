#pragma once

#include "render/image.h"

namespace slide {

/// An opaque picture of a cut-out: each pixel's colour by its alpha over what the opaque colours around
/// continue as. What is stored under transparent pixels means nothing (often it is black, which would leave a
/// dark rim), and does not show. The continuation is by pull-push over halved images, weighted by alpha
/// (Gortler et al. 1996, section 3.4). The same continues a map over its missing values: alpha 0 there, else
/// 1.
/// @param colour  H×W×C, finite
/// @param alpha   H×W×1, [0, 1]; somewhere positive, or the result is black
[[nodiscard]] Image over_own_colours(const Image& colour, const Image& alpha);

}  // namespace slide
