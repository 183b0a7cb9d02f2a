#pragma once

#include "render/image.h"

namespace slide::eval {

/// How well two pictures of one size agree where `mask` (H×W×1) is 1. All in float64, of sRGB values clamped
/// to [0, 1]; maps are computed from the whole pictures, so that windows see the pixels around the mask, and
/// averaged over it. NaN for an empty mask.

/// 10 log10(1 / MSE) over all channels of the masked pixels.
[[nodiscard]] double psnr(const Image& a, const Image& b, const Image& mask);

/// Structural similarity (Wang, Bovik, Sheikh, Simoncelli 2004, eq. 13) of BT.601 luma, Gaussian window of
/// 11×11 with sigma 1.5, K1 = 0.01, K2 = 0.03, range 1; at the picture's border the window is cut.
[[nodiscard]] double ssim(const Image& a, const Image& b, const Image& mask);

/// Multi-scale structural similarity (Wang, Simoncelli, Bovik, "Multi-scale structural similarity for image
/// quality assessment", 2003, eq. 7): the product over five scales of the means of contrast times structure,
/// and at the coarsest of SSIM, to the powers 0.0448, 0.2856, 0.3001, 0.2363, 0.1333; window and constants as
/// ssim(). From scale to scale pictures and mask are averaged over 2×2 pixels; the mask weighs the means. A
/// negative mean counts as 0.
[[nodiscard]] double ms_ssim(const Image& a, const Image& b, const Image& mask);

/// At which size gradients are compared.
enum class GradientScale {
  kHalf,  ///< averaged over 2×2 pixels first, as in the paper
  kFull,
};

/// Gradient magnitude similarity deviation (Xue, Zhang, Mou, Bovik 2014): the standard deviation of
/// (2 p q + c) / (p² + q² + c), p and q the gradients' magnitudes of luma times 255 by Prewitt's filters / 3,
/// c = 170. 0 for equal pictures. At the picture's border the last pixel is repeated; the mask is averaged
/// with the pictures and weighs the deviation, over n (the paper's over n - 1).
[[nodiscard]] double gmsd(const Image& a, const Image& b, const Image& mask,
                          GradientScale scale = GradientScale::kHalf);

/// `mask` without what lies within `part` of the width and height from the picture's border.
[[nodiscard]] Image without_border(const Image& mask, double part);

/// The inner rectangle that without_border() leaves of a picture.
[[nodiscard]] Image cropped(const Image& image, double part);

/// The fraction of pixels in the mask.
[[nodiscard]] double mask_fraction(const Image& mask);

}  // namespace slide::eval
