#include "render/rasterizer.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "coverage.h"

namespace slide {
namespace {

constexpr int kWidth = 67;
constexpr int kTop = 5;  // a band that does not begin at row 0
constexpr int kBottom = 48;
constexpr std::int32_t kLimit = kMaxCoordinate * kSubpixels;

using Triangle = std::array<ScreenVertex, 3>;

ScreenVertex vertex(std::int64_t x, std::int64_t y, float q = 1.0F) {
  return {static_cast<std::int32_t>(x), static_cast<std::int32_t>(y), q, 1.0F, 0.0F, 0.0F};
}

/// How often each pixel of the band is drawn when every triangle is drawn on its own.
std::vector<int> coverage_counts(const std::vector<Triangle>& triangles, Faces faces) {
  std::vector<int> counts(static_cast<std::size_t>(kWidth * (kBottom - kTop)), 0);
  FragmentBand band;
  for (const Triangle& t : triangles) {
    band.reset(kWidth, kTop, kBottom);
    draw_triangle(t[0], t[1], t[2], faces, band);
    std::size_t i = 0;
    for (int y = kTop; y < kBottom; ++y) {
      for (int x = 0; x < kWidth; ++x) counts[i++] += band.q(y)[x] > 0.0F ? 1 : 0;
    }
  }
  return counts;
}

std::vector<int> expected_counts(const std::vector<Triangle>& triangles) {
  std::vector<int> counts;
  for (int y = kTop; y < kBottom; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      int count = 0;
      for (const Triangle& t : triangles) {
        count += test::covers({t[0].x, t[0].y}, {t[1].x, t[1].y}, {t[2].x, t[2].y}, x, y) ? 1 : 0;
      }
      counts.push_back(count);
    }
  }
  return counts;
}

void check_against_oracle(const std::vector<Triangle>& triangles) {
  const std::vector<int> drawn = coverage_counts(triangles, Faces::kBoth);
  const std::vector<int> expected = expected_counts(triangles);
  CHECK(drawn == expected);
}

std::int64_t sample(std::mt19937& random, std::int64_t low, std::int64_t high) {
  return std::uniform_int_distribution<std::int64_t>(low, high)(random);
}

/// A grid of vertices `step` subpixels apart, each displaced by less than half a step so that nothing folds;
/// two triangles a cell, cut at random.
std::vector<Triangle> jittered_grid(std::mt19937& random, std::int64_t origin, std::int64_t step, int cells) {
  std::vector<ScreenVertex> grid;
  for (int j = 0; j <= cells; ++j) {
    for (int i = 0; i <= cells; ++i) {
      const std::int64_t x = origin + i * step + sample(random, -step / 5, step / 5);
      const std::int64_t y = origin + j * step + sample(random, -step / 5, step / 5);
      grid.push_back(
          vertex(std::clamp<std::int64_t>(x, -kLimit, kLimit), std::clamp<std::int64_t>(y, -kLimit, kLimit)));
    }
  }
  std::vector<Triangle> triangles;
  for (int j = 0; j < cells; ++j) {
    for (int i = 0; i < cells; ++i) {
      const std::size_t k = static_cast<std::size_t>(j * (cells + 1) + i);
      const ScreenVertex a = grid[k];
      const ScreenVertex b = grid[k + 1];
      const ScreenVertex c = grid[k + static_cast<std::size_t>(cells) + 1];
      const ScreenVertex d = grid[k + static_cast<std::size_t>(cells) + 2];
      if (sample(random, 0, 1) != 0) {
        triangles.push_back({a, b, d});
        triangles.push_back({c, a, d});
      } else {
        triangles.push_back({a, b, c});
        triangles.push_back({d, c, b});
      }
    }
  }
  return triangles;
}

void check_each_drawn_once(const std::vector<Triangle>& triangles) {
  const std::vector<int> counts = coverage_counts(triangles, Faces::kFront);
  CHECK(std::all_of(counts.begin(), counts.end(), [](int n) { return n == 1; }));
}

}  // namespace

TEST_CASE("random triangles cover the pixels that exact arithmetic says, whichever way they turn") {
  std::mt19937 random(11);
  for (const std::int64_t size : {300, 2000, 8000, 30000, 33000, 200000}) {
    CAPTURE(size);
    std::vector<Triangle> triangles;
    for (int i = 0; i < 40; ++i) {
      const std::int64_t x = sample(random, 0, kWidth * 256);
      const std::int64_t y = sample(random, 0, kBottom * 256);
      Triangle t;
      for (ScreenVertex& v : t) v = vertex(x + sample(random, -size, size), y + sample(random, -size, size));
      triangles.push_back(t);
    }
    check_against_oracle(triangles);
  }
}

TEST_CASE(
    "triangles with corners on pixel centres and edges along rows and columns follow the top-left rule") {
  std::mt19937 random(12);
  std::vector<Triangle> triangles;
  for (int i = 0; i < 300; ++i) {
    Triangle t;
    for (ScreenVertex& v : t) v = vertex(sample(random, 0, 12) * 256, sample(random, 4, 12) * 256);
    triangles.push_back(t);
  }
  check_against_oracle(triangles);
  // A square from centre to centre owns its upper and left centres alone.
  const std::vector<int> counts = coverage_counts({{vertex(0, 2048), vertex(1024, 2048), vertex(0, 3072)},
                                                   {vertex(1024, 2048), vertex(1024, 3072), vertex(0, 3072)}},
                                                  Faces::kFront);
  for (int y = kTop; y < kBottom; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const bool inside = x < 4 && y >= 8 && y < 12;
      CHECK(counts[static_cast<std::size_t>((y - kTop) * kWidth + x)] == (inside ? 1 : 0));
    }
  }
}

TEST_CASE("slivers cover the pixels that exact arithmetic says") {
  std::mt19937 random(13);
  std::vector<Triangle> triangles;
  for (int i = 0; i < 200; ++i) {
    const ScreenVertex a = vertex(sample(random, -3000, 20000), sample(random, -3000, 15000));
    const ScreenVertex b = vertex(sample(random, -3000, 20000), sample(random, -3000, 15000));
    const double t = static_cast<double>(sample(random, 0, 1000)) / 1000.0;
    triangles.push_back({a, b,
                         vertex(std::lround(a.x + t * (b.x - a.x)) + sample(random, -2, 2),
                                std::lround(a.y + t * (b.y - a.y)) + sample(random, -2, 2))});
  }
  check_against_oracle(triangles);
}

TEST_CASE("triangles as large as coordinates go cover the pixels that exact arithmetic says") {
  std::mt19937 random(14);
  std::vector<Triangle> triangles;
  for (int i = 0; i < 100; ++i) {
    Triangle t;
    for (ScreenVertex& v : t) v = vertex(sample(random, -kLimit, kLimit), sample(random, -kLimit, kLimit));
    triangles.push_back(t);
    // An edge through the band, its ends at the limit.
    const std::int64_t y = sample(random, 0, 12000);
    triangles.push_back({vertex(-kLimit, -kLimit + y), vertex(kLimit, kLimit - y), vertex(-kLimit, kLimit)});
  }
  triangles.push_back({vertex(-kLimit, -kLimit), vertex(kLimit, -kLimit), vertex(-kLimit, kLimit)});
  triangles.push_back({vertex(kLimit, kLimit), vertex(-kLimit, kLimit), vertex(kLimit, -kLimit)});
  check_against_oracle(triangles);
}

TEST_CASE("triangles without area cover nothing") {
  std::mt19937 random(15);
  std::vector<Triangle> triangles;
  for (int i = 0; i < 50; ++i) {
    const ScreenVertex a = vertex(sample(random, 0, 60) * 256, sample(random, 5, 40) * 256);
    const std::int64_t dx = sample(random, -10, 10) * 128;
    const std::int64_t dy = sample(random, -10, 10) * 128;
    triangles.push_back({a, a, a});
    triangles.push_back({a, a, vertex(a.x + dx, a.y + dy)});
    triangles.push_back({a, vertex(a.x + dx, a.y + dy), vertex(a.x - 2 * dx, a.y - 2 * dy)});
  }
  const std::vector<int> counts = coverage_counts(triangles, Faces::kBoth);
  CHECK(std::all_of(counts.begin(), counts.end(), [](int n) { return n == 0; }));
  check_against_oracle(triangles);
}

TEST_CASE("every pixel inside a mesh is drawn by exactly one triangle") {
  std::mt19937 random(16);
  // From half a pixel to the whole range of coordinates a cell; on whole pixels too, where centres lie on
  // edges.
  check_each_drawn_once(jittered_grid(random, -300, 200, 100));
  check_each_drawn_once(jittered_grid(random, -1000, 5000, 6));
  check_each_drawn_once(jittered_grid(random, -40000, 40000, 4));
  check_each_drawn_once(jittered_grid(random, -kLimit, kLimit, 2));
  check_each_drawn_once(jittered_grid(random, -512, 1024, 18));
  std::vector<Triangle> aligned = jittered_grid(random, -512, 256, 72);
  for (Triangle& t : aligned) {
    for (ScreenVertex& v : t) {
      v.x = (v.x + 128) >> 8 << 8;
      v.y = (v.y + 128) >> 8 << 8;
    }
  }
  check_each_drawn_once(aligned);
}

TEST_CASE("every pixel around a vertex where many triangles meet is drawn by exactly one of them") {
  std::mt19937 random(17);
  for (int i = 0; i < 20; ++i) {
    const bool on_centre = i % 2 == 0;
    const ScreenVertex hub = vertex(30 * 256 + (on_centre ? 0 : sample(random, 0, 255)), 25 * 256);
    std::vector<ScreenVertex> rim;
    constexpr int kSpokes = 23;
    for (int k = 0; k < kSpokes; ++k) {
      const double angle = 6.283185307179586 * (k + 0.3 * i / 20.0) / kSpokes;
      rim.push_back(
          vertex(hub.x + std::lround(30000 * std::cos(angle)), hub.y + std::lround(30000 * std::sin(angle))));
    }
    std::vector<Triangle> fan;
    for (std::size_t k = 0; k < rim.size(); ++k) fan.push_back({hub, rim[k], rim[(k + 1) % rim.size()]});
    check_each_drawn_once(fan);
  }
}

TEST_CASE("back faces are drawn only when asked for") {
  const std::vector<Triangle> back = {{vertex(0, 2000), vertex(0, 9000), vertex(9000, 2000)}};
  const std::vector<int> front_only = coverage_counts(back, Faces::kFront);
  CHECK(std::all_of(front_only.begin(), front_only.end(), [](int n) { return n == 0; }));
  const std::vector<int> both = coverage_counts(back, Faces::kBoth);
  CHECK(std::count(both.begin(), both.end(), 1) > 100);
}

TEST_CASE("attributes are the plane through the vertices, in small and in large triangles") {
  std::mt19937 random(18);
  for (const std::int64_t size : {600, 6000, 60000, 6000000}) {
    for (int repeat = 0; repeat < 20; ++repeat) {
      Triangle t;
      for (ScreenVertex& v : t) {
        v = vertex(8000 + sample(random, -size, size), 6000 + sample(random, -size, size));
        v.q = static_cast<float>(sample(random, 100, 1000)) / 1000.0F;
        v.s = static_cast<float>(sample(random, 100, 1000)) / 1000.0F;
        v.us = static_cast<float>(sample(random, -1000, 1000));
        v.vs = static_cast<float>(sample(random, -1000, 1000));
      }
      FragmentBand band;
      band.reset(kWidth, kTop, kBottom);
      draw_triangle(t[0], t[1], t[2], Faces::kBoth, band);
      const double bx = double(t[1].x) - t[0].x;
      const double by = double(t[1].y) - t[0].y;
      const double cx = double(t[2].x) - t[0].x;
      const double cy = double(t[2].y) - t[0].y;
      const double area = bx * cy - by * cx;
      for (int y = kTop; y < kBottom; ++y) {
        for (int x = 0; x < kWidth; ++x) {
          if (!(band.q(y)[x] > 0.0F)) continue;
          const double px = x * 256.0 - t[0].x;
          const double py = y * 256.0 - t[0].y;
          const double b1 = (px * cy - py * cx) / area;
          const double b2 = (bx * py - by * px) / area;
          const auto plane = [&](float a, float b, float c) {
            return a + b1 * (double(b) - a) + b2 * (double(c) - a);
          };
          // Three roundings of weights and three of sums of at most 3000, each 2^-24 of its value.
          CHECK(std::abs(double(band.q(y)[x]) - plane(t[0].q, t[1].q, t[2].q)) <= 8 * 3.0 / (1 << 24));
          CHECK(std::abs(double(band.s(y)[x]) - plane(t[0].s, t[1].s, t[2].s)) <= 8 * 3.0 / (1 << 24));
          CHECK(std::abs(double(band.us(y)[x]) - plane(t[0].us, t[1].us, t[2].us)) <= 8 * 3000.0 / (1 << 24));
          CHECK(std::abs(double(band.vs(y)[x]) - plane(t[0].vs, t[1].vs, t[2].vs)) <= 8 * 3000.0 / (1 << 24));
        }
      }
    }
  }
}

TEST_CASE("the nearer triangle is seen, and of two at the same depth the first") {
  const auto cover = [](float q, float name) {
    Triangle t = {vertex(-256, 0, q), vertex(90000, 0, q), vertex(-256, 90000, q)};
    for (ScreenVertex& v : t) v.us = name;
    return t;
  };
  FragmentBand band;
  band.reset(kWidth, kTop, kBottom);
  const auto draw = [&](const Triangle& t) { draw_triangle(t[0], t[1], t[2], Faces::kFront, band); };
  draw(cover(0.5F, 1.0F));
  draw(cover(0.25F, 2.0F));
  CHECK(band.us(20)[20] == 1.0F);
  draw(cover(0.75F, 3.0F));
  draw(cover(0.75F, 4.0F));
  CHECK(band.us(20)[20] == 3.0F);
  CHECK(band.q(20)[20] == 0.75F);
}

TEST_CASE("nothing is drawn outside the band's rows and columns") {
  std::vector<ScreenVertex> corners = {vertex(-kLimit, -kLimit), vertex(kLimit, -kLimit), vertex(0, kLimit)};
  FragmentBand band;
  band.reset(kWidth, kTop, kBottom);
  draw_triangle(corners[0], corners[1], corners[2], Faces::kFront, band);
  for (int y = kTop; y < kBottom; ++y) CHECK(band.q(y)[kWidth - 1] == 1.0F);
  band.reset(kWidth, 7, 7);
  draw_triangle(corners[0], corners[1], corners[2], Faces::kFront, band);
  band.reset(1, 7, 8);
  draw_triangle(corners[0], corners[1], corners[2], Faces::kFront, band);
  CHECK(band.q(7)[0] == 1.0F);
}

}  // namespace slide
