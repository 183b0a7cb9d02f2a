// The hierarchy: the photo is tiled by squares of kTile cells; a square is cut along a diagonal into two
// right isosceles triangles, and each triangle is halved from the middle of its hypotenuse to its right
// angle, until the legs are one cell long. A triangle is named by its hypotenuse (a, b) and right angle c.
// Two triangles that share a hypotenuse share its middle, so "split here" is one flag per pixel:
//   split[middle] = a child of either triangle is split, or either deviates by more than the tolerance.
// Levels are decided from the finest to the coarsest, each wholly before the next, over all tiles; then every
// tile lists the triangles that are left. Triangles that reach beyond the photo are always split: the grid
// lines of the outline are edges of the finest level, so those that remain are inside or outside.
#include <algorithm>
#include <atomic>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <utility>
#include <vector>

#include "render/mesh.h"
#include "runtime/threads.h"

namespace slide {
namespace {

constexpr int kTile = 64;
constexpr int kLevels = 13;  // log2(kTile) · 2 halvings, and the tile's own two triangles

struct Point {
  int x, y;
};

struct RightTriangle {
  Point a, b, c;  ///< clockwise; the right angle is at c

  /// The middle of the hypotenuse; a pixel as long as the hypotenuse is longer than a cell's diagonal.
  [[nodiscard]] Point middle() const { return {(a.x + b.x) / 2, (a.y + b.y) / 2}; }
  [[nodiscard]] RightTriangle first_child() const { return {c, a, middle()}; }
  [[nodiscard]] RightTriangle second_child() const { return {b, c, middle()}; }
  [[nodiscard]] bool finest() const { return std::abs(a.x - b.x) <= 1 && std::abs(a.y - b.y) <= 1; }
};

class Refinement {
 public:
  Refinement(const Image& disparity, double tolerance)
      : disparity_(disparity),
        tolerance_(tolerance),
        tiles_x_(std::max(1, (disparity.width - 1 + kTile - 1) / kTile)),
        tiles_y_(std::max(1, (disparity.height - 1 + kTile - 1) / kTile)),
        split_(disparity.pixels(), 0) {
    for (int level = kLevels - 2; level >= 0; --level) {
      parallel_for(tile_count(), [&](std::int64_t tile) {
        for (int half = 0; half < 2; ++half) decide(root(tile, half), level);
      });
    }
  }

  [[nodiscard]] std::int64_t tile_count() const { return std::int64_t{tiles_x_} * tiles_y_; }

  /// Calls emit(triangle) for every triangle left in a tile.
  template <typename Emit>
  void list(std::int64_t tile, const Emit& emit) const {
    for (int half = 0; half < 2; ++half) list(root(tile, half), emit);
  }

 private:
  [[nodiscard]] RightTriangle root(std::int64_t tile, int half) const {
    const int x = static_cast<int>(tile % tiles_x_) * kTile;
    const int y = static_cast<int>(tile / tiles_x_) * kTile;
    // The diagonals of the tiles need not alternate: no triangle straddles two tiles.
    const Point origin{x, y};
    const Point far{x + kTile, y + kTile};
    if (half == 0) return {far, origin, {x + kTile, y}};
    return {origin, far, {x, y + kTile}};
  }

  [[nodiscard]] bool outside(const RightTriangle& t) const {
    return std::min({t.a.x, t.b.x, t.c.x}) >= disparity_.width - 1 ||
           std::min({t.a.y, t.b.y, t.c.y}) >= disparity_.height - 1;
  }
  [[nodiscard]] bool inside(const RightTriangle& t) const {
    return std::max({t.a.x, t.b.x, t.c.x}) < disparity_.width &&
           std::max({t.a.y, t.b.y, t.c.y}) < disparity_.height;
  }
  [[nodiscard]] double value(Point p) const { return disparity_.at(p.x, p.y); }

  [[nodiscard]] bool flag(Point p) const { return split_[disparity_.index(p.x, p.y)] != 0; }
  /// Two tiles may set the flag of a pixel on their common edge at once; nobody reads it before the next
  /// level.
  void set_flag(Point p) {
    std::atomic_ref(split_[disparity_.index(p.x, p.y)]).store(1, std::memory_order_relaxed);
  }
  [[nodiscard]] bool is_split(const RightTriangle& t) const {
    return !t.finest() && (!inside(t) || flag(t.middle()));
  }

  void decide(const RightTriangle& t, int level) {
    if (t.finest() || outside(t)) return;
    if (level > 0) {
      decide(t.first_child(), level - 1);
      decide(t.second_child(), level - 1);
      return;
    }
    const Point m = t.middle();
    if (!inside(t)) {
      if (m.x < disparity_.width && m.y < disparity_.height) set_flag(m);
      return;
    }
    if (is_split(t.first_child()) || is_split(t.second_child()) || deviates(t)) set_flag(m);
  }

  /// Whether a pixel inside the triangle is farther from its plane than the tolerance.
  [[nodiscard]] bool deviates(const RightTriangle& t) const {
    const double base = value(t.c);
    const Point p{t.a.x - t.c.x, t.a.y - t.c.y};
    const Point q{t.b.x - t.c.x, t.b.y - t.c.y};
    const int legs = p.x * p.x + p.y * p.y;
    // The legs are orthogonal and equally long: projections on them are the barycentric coordinates.
    const double along_p = (value(t.a) - base) / legs;
    const double along_q = (value(t.b) - base) / legs;
    const int y1 = std::max({t.a.y, t.b.y, t.c.y});
    const int x0 = std::min({t.a.x, t.b.x, t.c.x});
    const int x1 = std::max({t.a.x, t.b.x, t.c.x});
    for (int y = std::min({t.a.y, t.b.y, t.c.y}); y <= y1; ++y) {
      const float* row = disparity_.row(y);
      for (int x = x0; x <= x1; ++x) {
        const int i = (x - t.c.x) * p.x + (y - t.c.y) * p.y;
        const int j = (x - t.c.x) * q.x + (y - t.c.y) * q.y;
        if (i < 0 || j < 0 || i + j > legs) continue;
        if (std::abs(base + along_p * i + along_q * j - static_cast<double>(row[x])) > tolerance_)
          return true;
      }
    }
    return false;
  }

  template <typename Emit>
  void list(const RightTriangle& t, const Emit& emit) const {
    if (outside(t)) return;
    if (is_split(t)) {
      list(t.first_child(), emit);
      list(t.second_child(), emit);
    } else {
      emit(t);
    }
  }

  const Image& disparity_;
  double tolerance_;
  int tiles_x_;
  int tiles_y_;
  std::vector<std::uint8_t> split_;
};

/// Numbers the vertices in use, in the order of the triangles, and adds the border of half a pixel.
class Assembly {
 public:
  explicit Assembly(const Image& disparity)
      : disparity_(disparity),
        columns_(static_cast<std::size_t>(disparity.width) + 2),
        ids_(columns_ * (static_cast<std::size_t>(disparity.height) + 2), kUnused) {
    mesh_.width = disparity.width;
    mesh_.height = disparity.height;
  }

  void add(const RightTriangle& t) {
    mesh_.triangles.push_back({id(t.a), id(t.b), id(t.c)});
    add_border(t.a, t.b);
    add_border(t.b, t.c);
    add_border(t.c, t.a);
  }

  /// The border beside an edge from p to q, if the outline of the pixel centres runs along it.
  void add_border(Point p, Point q) {
    const int right = disparity_.width - 1;
    const int bottom = disparity_.height - 1;
    if (p.y == 0 && q.y == 0) add_strip(p, q, {0, -1});
    if (p.y == bottom && q.y == bottom) add_strip(p, q, {0, 1});
    if (p.x == 0 && q.x == 0) add_strip(p, q, {-1, 0});
    if (p.x == right && q.x == right) add_strip(p, q, {1, 0});
  }

  /// The border along a photo of a single row or column, which has no triangles between its pixels.
  void add_lines() {
    for (int x = 0; disparity_.height == 1 && x + 1 < disparity_.width; ++x) {
      add_strip({x, 0}, {x + 1, 0}, {0, -1});
      add_strip({x + 1, 0}, {x, 0}, {0, 1});
    }
    for (int y = 0; disparity_.width == 1 && y + 1 < disparity_.height; ++y) {
      add_strip({0, y}, {0, y + 1}, {1, 0});
      add_strip({0, y + 1}, {0, y}, {-1, 0});
    }
  }

  void add_corners() {
    for (const int x : {-1, disparity_.width}) {
      for (const int y : {-1, disparity_.height}) {
        const int inner_x = std::clamp(x, 0, disparity_.width - 1);
        const int inner_y = std::clamp(y, 0, disparity_.height - 1);
        if ((x < 0) == (y < 0)) {
          add_quad({inner_x, inner_y}, {x, inner_y}, {x, y}, {inner_x, y});
        } else {
          add_quad({x, inner_y}, {inner_x, inner_y}, {inner_x, y}, {x, y});
        }
      }
    }
  }

  [[nodiscard]] Mesh take() { return std::move(mesh_); }

 private:
  static constexpr std::uint32_t kUnused = 0xFFFFFFFFU;

  void add_strip(Point p, Point q, Point out) {
    add_quad(q, p, {p.x + out.x, p.y + out.y}, {q.x + out.x, q.y + out.y});
  }

  void add_quad(Point p, Point q, Point r, Point s) {
    const std::uint32_t a = id(p);
    const std::uint32_t c = id(r);
    mesh_.triangles.push_back({a, id(q), c});
    mesh_.triangles.push_back({a, c, id(s)});
  }

  /// The vertex at pixel p, or on the border for coordinates -1 and the size.
  std::uint32_t id(Point p) {
    std::uint32_t& number =
        ids_[static_cast<std::size_t>(p.y + 1) * columns_ + static_cast<std::size_t>(p.x + 1)];
    if (number == kUnused) {
      number = static_cast<std::uint32_t>(mesh_.u.size());
      mesh_.u.push_back(
          std::clamp(static_cast<float>(p.x), -0.5F, static_cast<float>(disparity_.width) - 0.5F));
      mesh_.v.push_back(
          std::clamp(static_cast<float>(p.y), -0.5F, static_cast<float>(disparity_.height) - 0.5F));
      mesh_.disparity.push_back(
          disparity_.at(std::clamp(p.x, 0, disparity_.width - 1), std::clamp(p.y, 0, disparity_.height - 1)));
    }
    return number;
  }

  const Image& disparity_;
  std::size_t columns_;
  std::vector<std::uint32_t> ids_;
  Mesh mesh_;
};

}  // namespace

Mesh adaptive_mesh(const Image& disparity, double tolerance) {
  assert(disparity.channels == 1);
  Assembly assembly(disparity);
  if (disparity.width > 1 && disparity.height > 1) {
    const Refinement refinement(disparity, tolerance);
    for (std::int64_t tile = 0; tile < refinement.tile_count(); ++tile) {
      refinement.list(tile, [&](const RightTriangle& t) { assembly.add(t); });
    }
  }
  assembly.add_lines();
  assembly.add_corners();
  return assembly.take();
}

}  // namespace slide
