#pragma once

#include <cstdint>

namespace slide::test {

struct FixedPoint {
  std::int64_t x, y;  ///< in 1/256 pixel
};

/// The sign of the doubled area of a, b, p', where p' is p moved by (e, e²) for an e that is positive and
/// smaller than anything: exact, and never 0 unless a = b. Moving every centre by the same amount puts it
/// inside exactly one of the triangles that meet at an edge or a vertex; that the amount goes right, and down
/// by less, is the top-left rule.
inline int side(FixedPoint a, FixedPoint b, FixedPoint p) {
  const std::int64_t area = (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x);
  if (area != 0) return area > 0 ? 1 : -1;
  // d(area)/dp.x = -(b.y - a.y), d(area)/dp.y = b.x - a.x
  if (b.y != a.y) return b.y < a.y ? 1 : -1;
  return b.x > a.x ? 1 : (b.x < a.x ? -1 : 0);
}

/// Whether the centre of a pixel belongs to a triangle, whichever way round it is.
inline bool covers(FixedPoint a, FixedPoint b, FixedPoint c, int pixel_x, int pixel_y) {
  const FixedPoint p{std::int64_t{pixel_x} * 256, std::int64_t{pixel_y} * 256};
  const int first = side(a, b, p);
  return first != 0 && first == side(b, c, p) && first == side(c, a, p);
}

}  // namespace slide::test
