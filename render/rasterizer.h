#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace slide {

/// Screen coordinates are fixed-point numbers with this many fractional bits; pixel (x, y) has its centre at
/// (x << kSubpixelBits, y << kSubpixelBits).
inline constexpr int kSubpixelBits = 8;
inline constexpr int kSubpixels = 1 << kSubpixelBits;

/// The largest absolute screen coordinate in pixels; what lies beyond is clipped before it gets here. Edge
/// vectors then have components below 2^30 subpixels, products stay below 2^60 and an edge function below
/// 2^61: int64 holds it.
inline constexpr std::int32_t kMaxCoordinate = 1 << 20;

/// A vertex on the screen. q, s, us and vs are linear over the screen; us/s and vs/s are the texture
/// coordinates. With s = 1/Z of the homogeneous (X, Y, Z) = M (u, v, 1, w) they are the place of the photo
/// that is projected on the triangle's plane: the perspective of the view and that of the photo, both. (With
/// s = q, textures would be linear over the triangle in space, and the photo bent inside triangles that do
/// not face it.)
struct ScreenVertex {
  std::int32_t x, y;  ///< fixed point, at most kMaxCoordinate << kSubpixelBits in size
  float q;            ///< 1 / depth in the view, positive
  float s;            ///< denominator of the texture coordinates, positive
  float us, vs;       ///< texture coordinates times s
};

/// What is nearest at each pixel of some rows of a view: q (0 where nothing was drawn), s, us and vs.
/// Only rows [y0, y1) and columns [0, width) are drawn to.
class FragmentBand {
 public:
  /// Makes room for rows [y0, y1) and empties them. Memory is kept for the next reset.
  void reset(int width, int y0, int y1);

  [[nodiscard]] int width() const noexcept { return width_; }
  [[nodiscard]] int y0() const noexcept { return y0_; }
  [[nodiscard]] int y1() const noexcept { return y1_; }
  [[nodiscard]] float* q(int y) noexcept { return q_.data() + offset(y); }
  [[nodiscard]] float* s(int y) noexcept { return s_.data() + offset(y); }
  [[nodiscard]] float* us(int y) noexcept { return us_.data() + offset(y); }
  [[nodiscard]] float* vs(int y) noexcept { return vs_.data() + offset(y); }
  [[nodiscard]] const float* q(int y) const noexcept { return q_.data() + offset(y); }
  [[nodiscard]] const float* s(int y) const noexcept { return s_.data() + offset(y); }
  [[nodiscard]] const float* us(int y) const noexcept { return us_.data() + offset(y); }
  [[nodiscard]] const float* vs(int y) const noexcept { return vs_.data() + offset(y); }
  /// Floats from one row to the next: at least width + 3, so that whole groups of four can be read and
  /// written.
  [[nodiscard]] std::size_t stride() const noexcept { return stride_; }

 private:
  [[nodiscard]] std::size_t offset(int y) const noexcept {
    return static_cast<std::size_t>(y - y0_) * stride_;
  }
  int width_ = 0;
  int y0_ = 0;
  int y1_ = 0;
  std::size_t stride_ = 0;
  std::vector<float> q_, s_, us_, vs_;
};

enum class Faces { kFront, kBoth };

/// Draws the triangle a, b, c where it is nearer (q greater) than what is there; among equals the first drawn
/// stays.
///
/// A pixel is covered if its centre is inside, or on a top or left edge (Direct3D's and OpenGL's usual rule):
/// of triangles that share an edge exactly one has a centre that lies on it. Tests are exact integer
/// arithmetic. Front faces turn clockwise on the screen; back faces are left out for Faces::kFront. Triangles
/// without area cover nothing.
///
/// With b1 = E_ca / (2 area), b2 = E_ab / (2 area) of the edge functions at the centre, each quotient one
/// float multiplication by the rounded reciprocal, an attribute is a + b1 (b - a) + b2 (c - a): at a vertex's
/// own pixel centre it is the vertex's within two roundings.
void draw_triangle(const ScreenVertex& a, const ScreenVertex& b, const ScreenVertex& c, Faces faces,
                   FragmentBand& band);

/// One row of cells of a grid of vertices, between an upper and a lower row of them.
struct GridRow {
  const std::int32_t* x[2];  ///< of the upper and of the lower vertices
  const std::int32_t* y[2];
  const float* q[2];
  const float* s[2];
  const float* u;  ///< texture coordinate of each column, the same above and below; us = u · s
  float v[2];      ///< texture coordinate of each vertex row; vs = v · s
  int row;         ///< of the grid; main_diagonal(column, row) says how the cells are cut
};

/// Draws the two triangles of each cell [first, last) of the row, as draw_triangle() with Faces::kFront
/// would, bit for bit, but faster for cells of few pixels. All of the cells' vertices must be good
/// ScreenVertices.
void draw_cells(const GridRow& grid, int first, int last, FragmentBand& band);

}  // namespace slide
