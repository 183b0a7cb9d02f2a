#pragma once

#include <cstdint>

#include "runtime/graph.h"

namespace slide::graphs {

/// What lies around each pixel of a map, N×C×H×W, at its size; beyond the border is nothing.

/// The largest value within `radius` pixels along both axes, and the least.
Value largest_around(Value x, std::int64_t radius);
Value least_around(Value x, std::int64_t radius);

/// The mean of the values within `radius` pixels along both axes.
Value mean_around(Value x, std::int64_t radius);

/// The mean over 2·radius + 1 pixels and more, at any radius in constant time: of cells of about a quarter of
/// the radius, over the cells of the window, enlarged bilinearly.
Value smooth_mean(Value x, std::int64_t radius);

/// 3t² - 2t³, t = clip((x - from) / (to - from), 0, 1).
Value smoothstep(Value x, double from, double to);

/// A length in pixels, rounded, that is a part of the longer side of a map or photo.
[[nodiscard]] std::int64_t pixels_of(Value map, double part);

}  // namespace slide::graphs
