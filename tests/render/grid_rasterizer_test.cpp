#include <doctest/doctest.h>

#include <cstring>
#include <random>
#include <vector>

#include "render/mesh.h"
#include "render/rasterizer.h"

namespace slide {
namespace {

constexpr int kColumns = 33;
constexpr int kRows = 25;

struct Grid {
  std::vector<std::int32_t> x, y;
  std::vector<float> q, s, u, v;
};

std::size_t at(int column, int row) { return static_cast<std::size_t>(row * kColumns + column); }

/// Vertices `step` subpixels apart, displaced at random by up to `jitter` in each direction, rounded to
/// multiples of `snap`.
Grid random_grid(unsigned seed, int step, int jitter, int snap) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<std::int32_t> displace(-jitter, jitter);
  std::uniform_real_distribution<float> depth(0.1F, 1.0F);
  const int origin = step < 100 ? 600 : -700;
  Grid grid;
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      grid.x.push_back((column * step + origin + displace(random)) / snap * snap);
      grid.y.push_back((row * step + origin + displace(random)) / snap * snap);
      grid.q.push_back(depth(random));
      grid.s.push_back(depth(random));
      grid.u.push_back(static_cast<float>(column));
      grid.v.push_back(static_cast<float>(row));
    }
  }
  return grid;
}

void draw_by_cells(const Grid& grid, FragmentBand& band) {
  for (int row = 0; row + 1 < kRows; ++row) {
    const std::size_t upper = at(0, row);
    const std::size_t lower = at(0, row + 1);
    const GridRow cells{{&grid.x[upper], &grid.x[lower]},
                        {&grid.y[upper], &grid.y[lower]},
                        {&grid.q[upper], &grid.q[lower]},
                        {&grid.s[upper], &grid.s[lower]},
                        grid.u.data(),
                        {grid.v[upper], grid.v[lower]},
                        row};
    draw_cells(cells, 0, 10, band);
    draw_cells(cells, 10, kColumns - 1, band);
  }
}

void draw_by_triangles(const Grid& grid, FragmentBand& band) {
  const auto vertex = [&](int column, int row) {
    const std::size_t i = at(column, row);
    return ScreenVertex{
        grid.x[i], grid.y[i], grid.q[i], grid.s[i], grid.u[i] * grid.s[i], grid.v[i] * grid.s[i]};
  };
  for (int row = 0; row + 1 < kRows; ++row) {
    for (int column = 0; column + 1 < kColumns; ++column) {
      const ScreenVertex a = vertex(column, row);
      const ScreenVertex b = vertex(column + 1, row);
      const ScreenVertex c = vertex(column, row + 1);
      const ScreenVertex d = vertex(column + 1, row + 1);
      const bool main = main_diagonal(column, row);
      draw_triangle(a, b, main ? d : c, Faces::kFront, band);
      draw_triangle(main ? a : b, d, c, Faces::kFront, band);
    }
  }
}

}  // namespace

TEST_CASE(
    "cells give the bits of their triangles one by one, tiny, large, folded, without area and on centres") {
  struct Kind {
    int step, jitter, snap;
  };
  for (const Kind& kind :
       {Kind{256, 0, 256}, Kind{256, 90, 1}, Kind{200, 700, 1}, Kind{256, 300, 256}, Kind{40, 30, 1},
        Kind{700, 250, 1}, Kind{700, 2500, 64}, Kind{9000, 4000, 1}, Kind{60000, 9000, 1}}) {
    for (unsigned seed = 1; seed <= 3; ++seed) {
      CAPTURE(kind.step);
      CAPTURE(kind.jitter);
      const Grid grid = random_grid(seed, kind.step, kind.jitter, kind.snap);
      FragmentBand cells;
      FragmentBand triangles;
      cells.reset(41, 3, 29);
      triangles.reset(41, 3, 29);
      draw_by_cells(grid, cells);
      draw_by_triangles(grid, triangles);
      int covered = 0;
      int different = 0;
      for (int y = 3; y < 29; ++y) {
        for (int x = 0; x < 41; ++x) {
          const bool there = triangles.q(y)[x] > 0.0F;
          covered += there ? 1 : 0;
          const bool same = cells.q(y)[x] == triangles.q(y)[x] &&
                            (!there || (std::memcmp(cells.s(y) + x, triangles.s(y) + x, 4) == 0 &&
                                        std::memcmp(cells.us(y) + x, triangles.us(y) + x, 4) == 0 &&
                                        std::memcmp(cells.vs(y) + x, triangles.vs(y) + x, 4) == 0));
          different += same ? 0 : 1;
        }
      }
      CHECK(different == 0);
      CHECK(covered > 15);
    }
  }
}

}  // namespace slide
