#pragma once

#include "runtime/graph.h"

namespace slide::ops {

/// The colours F of a subject and B of what is behind it where a photo I shows a mixture of both,
/// I = alpha·F + (1 - alpha)·B: multi-level foreground estimation (Germer, Uelwer, Conrad and Harmeling,
/// "Fast Multi-Level Foreground Estimation", ICPR 2020, with the authors' values). F and B minimise
///   sum over pixels i of (alpha_i·F_i + (1 - alpha_i)·B_i - I_i)²
///     + sum over their four neighbours j of w_ij·((F_i - F_j)² + (B_i - B_j)²),   w_ij = 1e-5 + |alpha_i -
///     alpha_j|
/// approximately: level l = 0, 1 ... n = ceil(log2(max(H, W))) has round(H^(l/n)) × round(W^(l/n)) pixels,
/// picks I and alpha, F and B of the level before by nearest neighbour (pixel floor(i·before/size)), and
/// improves them 10 times where neither side exceeds 32 pixels, else twice. Before the first, F is the mean
/// of I where alpha > 0.9 and B that where alpha < 0.1, 0 if there is no such pixel. One step, all pixels at
/// once: with f and b the means of the neighbours' F and B, weighted with w (the border replicated), d the
/// sum of the weights and r = I - alpha·f - (1 - alpha)·b,
///   F = clip(f + alpha·r / q, 0, 1),  B = clip(b + (1 - alpha)·r / q, 0, 1),  q = alpha² + (1 - alpha)² + d.
/// @param image  N×C×H×W in [0, 1];  @param alpha  N×1×H×W in [0, 1];  both finite
/// @return N×2C×H×W in [0, 1]: F, then B
/// Throws Error(kInternal) naming the layer and the shapes that do not fit.
Value foreground_colours(Value image, Value alpha);

}  // namespace slide::ops
