#pragma once

#include <cstdint>

#include "runtime/graph.h"

namespace slide::ops {

/// Gaussian blur of each plane of N×C×H×W: separable, taps exp(-i²/(2·sigma²)) for |i| <= ceil(3·sigma),
/// normalised to sum 1; the border is replicated. sigma = 0 is the identity.
Value gaussian_blur(Value x, double sigma);

/// Sobel responses divided by 8, so that they are the slope per pixel of a plane; the border is replicated.
/// x: N×1×H×W; the result N×2×H×W holds gx = ([1 2 1]^T ∗ [-1 0 1])/8 and gy, its transpose.
Value sobel(Value x);

/// Dilation by a cone along scan lines (docs/method.md, section 4): y(p) = max over i in N(p) of x(i) - rho·K(i),
/// N(p) = the pixels of the same row and of the same column within `radius` pixels, p itself included, K the
/// distance. The window is cut at the image's border (replicating it would change nothing: a copy is farther
/// than what it copies). rho >= 0, radius >= 0, of any size. x: N×C×H×W. NaN in x spreads to all windows that
/// contain it. The fast kernel is exact and O(pixels) for every radius.
Value cone_dilation(Value x, double rho, std::int64_t radius);

}  // namespace slide::ops
