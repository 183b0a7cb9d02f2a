#include "render/mesh.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <utility>
#include <vector>

#include "runtime/threads.h"

namespace slide {
namespace {

Image random_disparity(int width, int height, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> value(0.0F, 1.0F);
  Image image(width, height, 1);
  for (float& d : image.data) d = value(random);
  return image;
}

/// Smooth hills with a step.
Image hills(int width, int height) {
  Image image(width, height, 1);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double step = x + 2 * y > width ? 0.3 : 0.0;
      image.at(x, y) = static_cast<float>(0.3 + 0.2 * std::sin(x / 25.0) * std::cos(y / 31.0) + step);
    }
  }
  return image;
}

double doubled_area(const Mesh& m, const std::array<std::uint32_t, 3>& t) {
  const auto [a, b, c] = t;
  return (double(m.u[b]) - m.u[a]) * (double(m.v[c]) - m.v[a]) -
         (double(m.v[b]) - m.v[a]) * (double(m.u[c]) - m.u[a]);
}

/// Every triangle turns clockwise, together they have the photo's area, and every edge is used once in each
/// direction, save on the outline of the photo's area, of which each part is used once: no crack, no overlap,
/// no vertex in an edge.
void check_watertight(const Mesh& m) {
  double area = 0.0;
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  bool clockwise = true;
  for (std::size_t i = 0; i < m.triangle_count(); ++i) {
    const auto t = m.triangle(i);
    clockwise = clockwise && doubled_area(m, t) > 0.0;
    area += doubled_area(m, t) / 2.0;
    for (std::size_t k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
  }
  CHECK(clockwise);
  CHECK(area == doctest::Approx(double(m.width) * m.height).epsilon(1e-12));
  int repeated = 0;
  int cracks = 0;
  double outline = 0.0;
  for (const auto& [edge, count] : edges) {
    repeated += count != 1 ? 1 : 0;
    if (edges.count({edge.second, edge.first}) != 0) continue;
    const std::uint32_t a = edge.first;
    const std::uint32_t b = edge.second;
    const auto on_line = [&](const std::vector<float>& at, float line) {
      return at[a] == line && at[b] == line;
    };
    const bool outer = on_line(m.u, -0.5F) || on_line(m.v, -0.5F) || on_line(m.u, float(m.width) - 0.5F) ||
                       on_line(m.v, float(m.height) - 0.5F);
    cracks += outer ? 0 : 1;
    outline += std::abs(double(m.u[a]) - m.u[b]) + std::abs(double(m.v[a]) - m.v[b]);
  }
  CHECK(repeated == 0);
  CHECK(cracks == 0);
  CHECK(outline == doctest::Approx(2.0 * (m.width + m.height)).epsilon(1e-12));
}

/// Heights of a mesh at points of a lattice of sixths of a pixel; NaN where not asked for.
struct Lattice {
  explicit Lattice(const Mesh& mesh)
      : columns(6 * mesh.width + 1),
        heights(std::size_t(columns) * std::size_t(6 * mesh.height + 1), std::nan("")) {}
  static int place(double coordinate) { return static_cast<int>(std::lround((coordinate + 0.5) * 6)); }
  double& at(int i, int j) { return heights[std::size_t(j) * std::size_t(columns) + std::size_t(i)]; }

  int columns;
  std::vector<double> heights;
};

/// The mesh's heights at its vertices, edge middles and centroids.
Lattice sampled_heights(const Mesh& mesh) {
  constexpr double kThird = 1.0 / 3.0;
  constexpr double kWeights[7][3] = {
      {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.5, 0.5, 0}, {0, 0.5, 0.5}, {0.5, 0, 0.5}, {kThird, kThird, kThird}};
  Lattice lattice(mesh);
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
    const auto t = mesh.triangle(i);
    for (const auto& w : kWeights) {
      double u = 0.0;
      double v = 0.0;
      double d = 0.0;
      for (std::size_t k = 0; k < 3; ++k) {
        u += w[k] * double(mesh.u[t[k]]);
        v += w[k] * double(mesh.v[t[k]]);
        d += w[k] * double(mesh.disparity[t[k]]);
      }
      lattice.at(Lattice::place(u), Lattice::place(v)) = d;
    }
  }
  return lattice;
}

/// The largest difference between the heights of two meshes of one photo, at the vertices, edge middles and
/// centroids of the fine mesh's triangles; found by visiting each triangle of the coarse one.
double largest_difference(const Mesh& fine, const Mesh& coarse) {
  Lattice lattice = sampled_heights(fine);
  std::vector<bool> seen(lattice.heights.size(), false);
  double largest = 0.0;
  for (std::size_t k = 0; k < coarse.triangle_count(); ++k) {
    const auto t = coarse.triangle(k);
    const auto [a, b, c] = t;
    const double bu = double(coarse.u[b]) - coarse.u[a];
    const double bv = double(coarse.v[b]) - coarse.v[a];
    const double cu = double(coarse.u[c]) - coarse.u[a];
    const double cv = double(coarse.v[c]) - coarse.v[a];
    const auto [u0, u1] = std::minmax({coarse.u[a], coarse.u[b], coarse.u[c]});
    const auto [v0, v1] = std::minmax({coarse.v[a], coarse.v[b], coarse.v[c]});
    for (int j = Lattice::place(v0); j <= Lattice::place(v1); ++j) {
      for (int i = Lattice::place(u0); i <= Lattice::place(u1); ++i) {
        const double there = lattice.at(i, j);
        const double du = i / 6.0 - 0.5 - coarse.u[a];
        const double dv = j / 6.0 - 0.5 - coarse.v[a];
        const double wb = (du * cv - dv * cu) / (bu * cv - bv * cu);
        const double wc = (bu * dv - bv * du) / (bu * cv - bv * cu);
        if (std::isnan(there) || wb < -1e-9 || wc < -1e-9 || wb + wc > 1.0 + 1e-9) continue;
        const double d = coarse.disparity[a] + wb * (double(coarse.disparity[b]) - coarse.disparity[a]) +
                         wc * (double(coarse.disparity[c]) - coarse.disparity[a]);
        largest = std::max(largest, std::abs(d - there));
        seen[std::size_t(j) * std::size_t(lattice.columns) + std::size_t(i)] = true;
      }
    }
  }
  std::size_t unseen = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) unseen += !std::isnan(lattice.heights[i]) && !seen[i] ? 1 : 0;
  CHECK(unseen == 0);
  return largest;
}

}  // namespace

TEST_CASE("the full mesh has two triangles per cell of pixels and border and covers the photo's area") {
  for (const auto& size : {std::pair{1, 1}, {1, 5}, {4, 1}, {2, 2}, {7, 5}, {16, 33}}) {
    const int width = size.first;
    const int height = size.second;
    CAPTURE(width);
    CAPTURE(height);
    const Mesh mesh = full_mesh(random_disparity(width, height, 1));
    CHECK(mesh.triangle_count() == std::size_t(2 * (width + 1) * (height + 1)));
    check_watertight(mesh);
  }
}

TEST_CASE("every pixel of the photo is a vertex of the full mesh with its disparity") {
  const Image disparity = random_disparity(6, 4, 2);
  const Mesh mesh = full_mesh(disparity);
  for (int y = 0; y < 4; ++y) {
    for (int x = 0; x < 6; ++x) {
      const auto i = std::size_t((y + 1) * mesh.grid_columns() + x + 1);
      CHECK(mesh.u[i] == float(x));
      CHECK(mesh.v[i] == float(y));
      CHECK(mesh.disparity[i] == disparity.at(x, y));
    }
  }
}

TEST_CASE("an adaptive mesh of noise without tolerance is the full mesh") {
  for (const auto& size : {std::pair{1, 1}, {1, 5}, {4, 1}, {2, 2}, {7, 5}, {66, 20}}) {
    const int width = size.first;
    const int height = size.second;
    const Image disparity = random_disparity(width, height, 3);
    const Mesh adaptive = adaptive_mesh(disparity, 0.0);
    const Mesh full = full_mesh(disparity);
    check_watertight(adaptive);
    CHECK(adaptive.triangle_count() == full.triangle_count());
    if (width > 2 || height > 2) CHECK(largest_difference(full, adaptive) <= 1e-9);
  }
}

TEST_CASE("an adaptive mesh of a plane has few triangles and no error") {
  Image plane(129, 193, 1);
  for (int y = 0; y < plane.height; ++y) {
    for (int x = 0; x < plane.width; ++x) plane.at(x, y) = static_cast<float>(x + 2 * y) / 1024.0F;
  }
  const Mesh mesh = adaptive_mesh(plane, 0.0);
  // 2 × 3 tiles of two triangles, two to each tile's side of the outline, two at each corner.
  CHECK(mesh.triangle_count() == 2 * 6 + 2 * 10 + 2 * 4);
  check_watertight(mesh);
  CHECK(largest_difference(full_mesh(plane), mesh) <= 1e-15);
}

TEST_CASE("an adaptive mesh has no cracks and nowhere exceeds its tolerance") {
  for (const auto& size : {std::pair{90, 71}, {65, 64}, {67, 129}}) {
    const int width = size.first;
    const int height = size.second;
    const Image disparity = hills(width, height);
    const Mesh full = full_mesh(disparity);
    std::size_t before = full.triangle_count() + 1;
    for (const double tolerance : {1e-4, 2e-3, 0.5}) {
      CAPTURE(width);
      CAPTURE(tolerance);
      const Mesh mesh = adaptive_mesh(disparity, tolerance);
      check_watertight(mesh);
      CHECK(largest_difference(full, mesh) <= tolerance * (1.0 + 1e-6));
      CHECK(mesh.triangle_count() < before);
      before = mesh.triangle_count();
    }
  }
}

TEST_CASE("an adaptive mesh is the same at any thread count") {
  const Image disparity = hills(200, 150);
  set_thread_count(1);
  const Mesh one = adaptive_mesh(disparity, 1e-3);
  for (const int threads : {2, 5}) {
    set_thread_count(threads);
    const Mesh many = adaptive_mesh(disparity, 1e-3);
    CHECK(many.triangles == one.triangles);
    CHECK(many.u == one.u);
    CHECK(many.v == one.v);
    CHECK(many.disparity == one.disparity);
  }
  set_thread_count(0);
}

}  // namespace slide
