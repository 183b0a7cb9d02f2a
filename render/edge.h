#pragma once

#include <cstdint>

#include "render/rasterizer.h"

namespace slide {

// What draw_triangle() and draw_cells() must agree on to the last bit.

/// Whether centres on the edge with direction (dx, dy) of a clockwise triangle belong to it: the edge goes up
/// (its inside is to the right: a left edge), or level to the right (its inside is below: a top edge).
constexpr bool owns_its_points(std::int64_t dx, std::int64_t dy) noexcept {
  return dy < 0 || (dy == 0 && dx > 0);
}

/// The first pixel whose centre is at or after a coordinate, and the last at or before one.
constexpr std::int32_t first_centre(std::int32_t fixed) noexcept {
  return (fixed + kSubpixels - 1) >> kSubpixelBits;
}
constexpr std::int32_t last_centre(std::int32_t fixed) noexcept { return fixed >> kSubpixelBits; }

/// a + b1 (b - a) + b2 (c - a), in this order, for a scalar or for lanes; ab and ac are the differences.
template <typename Lanes>
inline Lanes interpolate(Lanes a, Lanes ab, Lanes ac, Lanes b1, Lanes b2) noexcept {
  return (a + b1 * ab) + b2 * ac;
}

}  // namespace slide
