#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "render/image.h"

namespace slide {

/// A layer's geometry: a height field over the photo, cut into triangles.
///
/// Vertices lie at pixel centres, at the place (u, v) of the photo they texture, and carry the disparity
/// there. A border half a pixel wide surrounds them, of the outermost vertices repeated at u = -0.5, u = W -
/// 0.5 and so for v, so that the mesh covers the photo's whole area [-0.5, W-0.5] × [-0.5, H-0.5]: no pixel
/// centre of the photo lies on the outline of the mesh, where the top-left rule would drop the right and the
/// lower one.
///
/// Inverse depth is affine in disparity, and a plane in space has inverse depth affine in (u, v): so each
/// triangle is flat in space, and disparity inside it is interpolated linearly over the photo.
///
/// Triangles turn clockwise as seen in the photo, from u to v: (b - a) × (c - a) > 0 with x to the right and
/// y down.
struct Mesh {
  int width = 0;   ///< of the photo
  int height = 0;  ///< of the photo
  std::vector<float> u;
  std::vector<float> v;
  std::vector<float> disparity;
  /// The triangles of an adaptive mesh, neighbours near each other. Empty for a full mesh, whose triangles
  /// follow from the grid of its vertices, (W+2) to a row.
  std::vector<std::array<std::uint32_t, 3>> triangles;
  bool full = false;

  [[nodiscard]] int grid_columns() const noexcept { return width + 2; }
  [[nodiscard]] int grid_rows() const noexcept { return height + 2; }
  [[nodiscard]] std::size_t triangle_count() const noexcept;
  [[nodiscard]] std::array<std::uint32_t, 3> triangle(std::size_t index) const;
};

/// The diagonal of the cell between grid vertices (column, row) and (column + 1, row + 1) of a full mesh
/// joins those two if this is true, else the other two. Alternating diagonals make every coarser mesh of
/// right isosceles triangles a union of these triangles.
[[nodiscard]] constexpr bool main_diagonal(int column, int row) noexcept { return ((column + row) & 1) == 0; }

/// One vertex per pixel (and the border): 2 (W+1) (H+1) triangles, cell by cell along the rows.
/// `disparity` has one channel; check_layers() says what is good.
[[nodiscard]] Mesh full_mesh(const Image& disparity);

/// A mesh of fewer triangles that nowhere differs from the full one by more than `tolerance` in disparity, at
/// and between pixels, border included. Right triangles are merged bottom-up, as in Evans, Kirkpatrick and
/// Townsend, "Right- triangulated irregular networks" (2001): a pair of triangles is merged into its parent
/// only together with the pair on the other side of their common edge, so there is no vertex inside an edge,
/// and no crack. Deviations are measured at every pixel centre; both surfaces are linear between those,
/// because the triangles of the full mesh subdivide the coarse ones. Triangles have legs of at most 64
/// pixels.
///
/// A tolerance of `pixels / largest_parallax_rate(camera, views)` bounds the displacement of every point of
/// the photo, in every view, by that many pixels. The same mesh at any thread count.
[[nodiscard]] Mesh adaptive_mesh(const Image& disparity, double tolerance);

}  // namespace slide
