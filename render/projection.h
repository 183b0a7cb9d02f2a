#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "render/camera.h"
#include "render/mesh.h"
#include "render/rasterizer.h"

namespace slide {

/// From the vertices of a mesh to the screen of a view, width × height pixels.
/// With D the disparity and w its inverse depth, (X, Y, Z) = matrix · (u - centre, v - centre, 1, D) is the
/// point in the view's camera divided by its depth in the photo, X and Y scaled to pixels: it appears at (X,
/// Y) / Z + centre_out, with q = 1 / depth = w / Z and s = 1 / Z. Homogeneous coordinates of this kind need
/// no division by w, and are linear over a triangle.
struct Projection {
  double matrix[3][4];
  double inverse_depth_scale;  ///< w = scale · D + offset
  double inverse_depth_offset;
  double centre[2];      ///< of the photo
  double centre_out[2];  ///< of the view, its shift included
  double clip_depth;     ///< nothing nearer is drawn
};

[[nodiscard]] Projection make_projection(const Camera& camera, const View& view, int width, int height);

/// A run of a mesh's triangles, by what it may touch: cells [first, last) of one row of a full mesh, or
/// triangles [first, last) of an adaptive one.
struct Chunk {
  std::int32_t first, last;
  std::int32_t x0, y0, x1, y1;  ///< the pixels whose centres lie in the box of its vertices, inclusive
  bool clipped;                 ///< a vertex is clipped; then the box is unknown
};

/// A mesh's vertices on the screen, in fixed point. q is 1 / depth, or kClipped for a vertex that is behind
/// the clip plane or beyond kMaxCoordinate; its x and y are then meaningless.
struct ProjectedMesh {
  static constexpr float kClipped = -1.0F;
  std::vector<std::int32_t> x, y;
  std::vector<float> q, s;
  std::vector<Chunk> chunks;  ///< in the order of the triangles; of a full mesh, the same number for each row
};

/// Projects all vertices. float32 with one rounding to subpixels at the end: a coordinate below 2^13 is
/// within 1/512 + 2^-10 pixels of its exact place.
void project_mesh(const Projection& projection, const Mesh& mesh, ProjectedMesh& out);

/// Draws a triangle of which at least one vertex is clipped, as the parts of it that can be seen (Sutherland
/// and Hodgman, "Reentrant polygon clipping", 1974). An edge is cut from its inner to its outer end,
/// whichever triangle it is cut for, so that neighbours get the same point and share the edge still.
void draw_clipped_triangle(const Projection& projection, const Mesh& mesh, const ProjectedMesh& projected,
                           std::size_t triangle, FragmentBand& band);

/// Draws what a mesh shows in a band of rows, front faces only, in the order of its triangles.
void draw_mesh(const Projection& projection, const Mesh& mesh, const ProjectedMesh& projected,
               FragmentBand& band);

}  // namespace slide
