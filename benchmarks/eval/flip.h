#pragma once

#include "benchmarks/eval/plane.h"
#include "render/image.h"

namespace slide::eval {

/// Pixels per degree of visual angle at 0.7 m from a display of 0.7 m and 3840 pixels, as the authors assume.
inline constexpr double kFlipPixelsPerDegree = 0.7 * 3840 / 0.7 * 3.14159265358979323846 / 180;

/// FLIP (Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, "FLIP: A Difference Evaluator for
/// Alternating Images", 2020), for pictures of low dynamic range: the error that a viewer sees when both
/// alternate, per pixel in [0, 1], 0 for equal pictures. In float64, with the paper's constants:
///   - colours: filtered with the eye's contrast sensitivity in opponent space (Y, Cx, Cz), brought to
///     CIELAB with Hunt's adjustment, their HyAB distance to the power 0.7, of which up to 0.4 of the largest
///     (green to blue) is mapped to [0, 0.95];
///   - features: edges and points of Y, by first and second derivatives of a Gaussian 0.082 degrees wide;
///     the larger difference over √2, to the power 0.5;
///   - colour^(1 - features).
/// Beyond the border the last pixel is repeated.
/// @param a, b  H×W×3, sRGB-encoded, clamped to [0, 1]
[[nodiscard]] Plane flip_map(const Image& a, const Image& b, double pixels_per_degree = kFlipPixelsPerDegree);

/// Its mean where `mask` (H×W×1) is 1; NaN for an empty mask.
[[nodiscard]] double flip(const Image& a, const Image& b, const Image& mask);

}  // namespace slide::eval
