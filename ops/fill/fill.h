#pragma once

#include "runtime/graph.h"

namespace slide::ops {

/// Continues the known part of a picture smoothly into the rest: push-pull (Gortler et al., "The Lumigraph",
/// SIGGRAPH 1996, section 3.4) with a few steps of Laplace's equation at every level.
///
/// With w the weight and x the values of a level, starting from the input:
///   pull: halve until one cell is left:  m = B(w),  x' = B(w·x) / max(m, 1e-12),  w' = min(16·m, 1)
///         B: every second sample after the filter (1 3 3 1)/8 along rows and columns (samples 2i-1 to 2i+2
///         for cell i), zero beyond the border
///   push: from the last level up, Y the result of the level below enlarged bilinearly (half-pixel):
///         y = w·x + (1 - w)·Y,  then `sweeps` times  y = w·x + (1 - w)·mean of the four neighbours of y,
///         the border replicated.
/// Where w = 1 the result is x; where it is 0, x must be finite and does not matter. All steps are averages,
/// so the result lies between the smallest and the largest known value.
/// @param x       N×C×H×W
/// @param weight  N×1×H×W in [0, 1]
/// @param sweeps  >= 0
/// Throws Error(kInternal) naming the layer and the shapes that do not fit.
Value push_pull_fill(Value x, Value weight, int sweeps);

}  // namespace slide::ops
