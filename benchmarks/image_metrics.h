#pragma once

#include "render/image.h"

namespace slide {

/// How well two pictures agree where `mask` (H×W×1) is 1.

/// 10 log10(1 / MSE) over all channels of the masked pixels, both pictures clamped to [0, 1]. NaN for an
/// empty mask.
[[nodiscard]] double psnr(const Image& a, const Image& b, const Image& mask);

/// Structural similarity (Wang, Bovik, Sheikh, Simoncelli 2004, eq. 13) of BT.601 luma, Gaussian window of
/// 11×11 with sigma 1.5, K1 = 0.01, K2 = 0.03, range 1: the mean over masked pixels of the map, whose windows
/// see the pixels around the mask too; at the picture's border the window is cut. NaN for an empty mask.
[[nodiscard]] double ssim(const Image& a, const Image& b, const Image& mask);

/// `mask` without what lies within `part` of the width and height from the picture's border.
[[nodiscard]] Image without_border(const Image& mask, double part);

/// The fraction of pixels in the mask.
[[nodiscard]] double mask_fraction(const Image& mask);

}  // namespace slide
