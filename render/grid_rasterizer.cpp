// The cells of a full mesh, which are about as large as a pixel: most have one pixel centre in their bounding
// box, or none. All is computed from the vertices' offsets to that centre, E_ab = a × b, and nothing before
// the box is known to hold a centre; the 2 area of a triangle is the sum of its edge functions there. Cells
// of up to 64 pixels a side keep the products below 2^29.
#include <algorithm>

#include "render/edge.h"
#include "render/mesh.h"
#include "render/rasterizer.h"

namespace slide {
namespace {

constexpr std::int32_t kSmallCell = 1 << 14;

struct GridVertex {
  std::int32_t x, y;
  float q, s, u, v;
};

ScreenVertex screen_vertex(const GridVertex& g) { return {g.x, g.y, g.q, g.s, g.u * g.s, g.v * g.s}; }

struct Offset {
  std::int32_t x, y;
};

std::int32_t cross(Offset a, Offset b) { return a.x * b.y - b.x * a.y; }

/// Whether a centre with edge functions of at least 0 is inside: those that are 0 must belong to edges that
/// own it.
bool owned(std::int32_t ab, std::int32_t bc, std::int32_t ca, Offset a, Offset b, Offset c) {
  return (ab != 0 || owns_its_points(b.x - a.x, b.y - a.y)) &&
         (bc != 0 || owns_its_points(c.x - b.x, c.y - b.y)) &&
         (ca != 0 || owns_its_points(a.x - c.x, a.y - c.y));
}

/// Where a pixel's fragment is.
struct FragmentPlace {
  float *q, *s, *us, *vs;
};

/// Draws one pixel of the triangle that has positive area and the given edge functions there.
void draw_pixel(const GridVertex& a, const GridVertex& b, const GridVertex& c, std::int32_t ab,
                std::int32_t bc, std::int32_t ca, const FragmentPlace& out) {
  const float inverse_area = 1.0F / static_cast<float>(ab + bc + ca);
  const float b1 = static_cast<float>(ca) * inverse_area;
  const float b2 = static_cast<float>(ab) * inverse_area;
  const float q = interpolate(a.q, b.q - a.q, c.q - a.q, b1, b2);
  if (q > *out.q) {
    const float us = a.u * a.s;
    const float vs = a.v * a.s;
    *out.q = q;
    *out.s = interpolate(a.s, b.s - a.s, c.s - a.s, b1, b2);
    *out.us = interpolate(us, b.u * b.s - us, c.u * c.s - us, b1, b2);
    *out.vs = interpolate(vs, b.v * b.s - vs, c.v * c.s - vs, b1, b2);
  }
}

/// The corners a b above c d.
struct Cell {
  GridVertex a, b, c, d;
};

template <bool kMain>
void draw_cell(const Cell& cell, std::int32_t x0, std::int32_t y0, std::int32_t x1, std::int32_t y1,
               FragmentBand& band) {
  for (std::int32_t y = y0; y <= y1; ++y) {
    for (std::int32_t x = x0; x <= x1; ++x) {
      const std::int32_t px = x * kSubpixels;
      const std::int32_t py = y * kSubpixels;
      const Offset a{cell.a.x - px, cell.a.y - py};
      const Offset b{cell.b.x - px, cell.b.y - py};
      const Offset c{cell.c.x - px, cell.c.y - py};
      const Offset d{cell.d.x - px, cell.d.y - py};
      const std::int32_t ab = cross(a, b);
      const std::int32_t bd = cross(b, d);
      const std::int32_t dc = cross(d, c);
      const std::int32_t ca = cross(c, a);
      const FragmentPlace out{band.q(y) + x, band.s(y) + x, band.us(y) + x, band.vs(y) + x};
      if constexpr (kMain) {
        const std::int32_t da = cross(d, a);
        if ((ab | bd | da) >= 0 && ab + bd + da > 0 && owned(ab, bd, da, a, b, d)) {
          draw_pixel(cell.a, cell.b, cell.d, ab, bd, da, out);
        }
        if ((-da | dc | ca) >= 0 && dc + ca - da > 0 && owned(-da, dc, ca, a, d, c)) {
          draw_pixel(cell.a, cell.d, cell.c, -da, dc, ca, out);
        }
      } else {
        const std::int32_t bc = cross(b, c);
        if ((ab | bc | ca) >= 0 && ab + bc + ca > 0 && owned(ab, bc, ca, a, b, c)) {
          draw_pixel(cell.a, cell.b, cell.c, ab, bc, ca, out);
        }
        if ((bd | dc | -bc) >= 0 && bd + dc - bc > 0 && owned(bd, dc, -bc, b, d, c)) {
          draw_pixel(cell.b, cell.d, cell.c, bd, dc, -bc, out);
        }
      }
    }
  }
}

template <bool kMain>
void draw_large_cell(const Cell& cell, FragmentBand& band) {
  const ScreenVertex a = screen_vertex(cell.a);
  const ScreenVertex b = screen_vertex(cell.b);
  const ScreenVertex c = screen_vertex(cell.c);
  const ScreenVertex d = screen_vertex(cell.d);
  draw_triangle(a, b, kMain ? d : c, Faces::kFront, band);
  draw_triangle(kMain ? a : b, d, c, Faces::kFront, band);
}

template <bool kMain>
void visit_cell(const GridRow& grid, int column, FragmentBand& band) {
  const std::int32_t* const x_up = grid.x[0] + column;
  const std::int32_t* const x_low = grid.x[1] + column;
  const std::int32_t* const y_up = grid.y[0] + column;
  const std::int32_t* const y_low = grid.y[1] + column;
  const std::int32_t left = std::min(std::min(x_up[0], x_up[1]), std::min(x_low[0], x_low[1]));
  const std::int32_t right = std::max(std::max(x_up[0], x_up[1]), std::max(x_low[0], x_low[1]));
  const std::int32_t top = std::min(std::min(y_up[0], y_up[1]), std::min(y_low[0], y_low[1]));
  const std::int32_t bottom = std::max(std::max(y_up[0], y_up[1]), std::max(y_low[0], y_low[1]));
  const std::int32_t x0 = std::max(first_centre(left), 0);
  const std::int32_t x1 = std::min(last_centre(right), band.width() - 1);
  const std::int32_t y0 = std::max(first_centre(top), band.y0());
  const std::int32_t y1 = std::min(last_centre(bottom), band.y1() - 1);
  if (x0 > x1 || y0 > y1) return;
  const float u0 = grid.u[column];
  const float u1 = grid.u[column + 1];
  const Cell cell{{x_up[0], y_up[0], grid.q[0][column], grid.s[0][column], u0, grid.v[0]},
                  {x_up[1], y_up[1], grid.q[0][column + 1], grid.s[0][column + 1], u1, grid.v[0]},
                  {x_low[0], y_low[0], grid.q[1][column], grid.s[1][column], u0, grid.v[1]},
                  {x_low[1], y_low[1], grid.q[1][column + 1], grid.s[1][column + 1], u1, grid.v[1]}};
  if (right - left <= kSmallCell && bottom - top <= kSmallCell) {
    draw_cell<kMain>(cell, x0, y0, x1, y1, band);
  } else {
    draw_large_cell<kMain>(cell, band);
  }
}

}  // namespace

void draw_cells(const GridRow& grid, int first, int last, FragmentBand& band) {
  for (int column = first; column < last; ++column) {
    if (main_diagonal(column, grid.row)) {
      visit_cell<true>(grid, column, band);
    } else {
      visit_cell<false>(grid, column, band);
    }
  }
}

}  // namespace slide
