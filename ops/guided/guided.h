#pragma once

#include <cstdint>

#include "runtime/graph.h"

namespace slide::ops {

/// The guided filter (He, Sun and Tang, "Guided Image Filtering", PAMI 2013, eq. 5 to 8, 14 and 15) up to its
/// linear coefficients. With E the mean over the window of (2·radius + 1)² pixels, cut at the border:
///   a = (E[g·gᵀ] - E[g]·E[g]ᵀ + eps·1)⁻¹ · (E[g·x] - E[g]·E[x]),   b = E[x] - aᵀ·E[g]
/// for every window; the result holds the means E of the C planes of a and of b over the windows that contain
/// the pixel. Σ a_c·g_c + b is the filtered x: the closest thing to x that is locally linear in the guide.
/// The cost grows with the radius.
/// @param guide   N×C×H×W, C <= 8
/// @param x       N×1×H×W
/// @param radius  >= 0
/// @param eps     > 0, in the guide's units squared: edges of the guide well above its root are followed
/// @return N×(C+1)×H×W
/// Throws Error(kInternal) naming the layer and the shapes that do not fit.
Value guided_coefficients(Value guide, Value x, std::int64_t radius, double eps);

/// Enlarges x to the size of `guide` so that it follows the guide's edges: the fast guided filter (He and
/// Sun, "Fast Guided Filter", 2015). The coefficients are found at the size of x and enlarged bilinearly
/// (half-pixel). The result may leave the range of x.
/// @param x            N×1×h×w
/// @param small_guide  N×C×h×w, the guide at the size of x
/// @param guide        N×C×H×W;  @return N×1×H×W
Value guided_upsample(Value x, Value small_guide, Value guide, std::int64_t radius, double eps);

}  // namespace slide::ops
