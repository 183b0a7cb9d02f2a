#include "render/projection.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "render/edge.h"
#include "runtime/threads.h"

namespace slide {
namespace {

constexpr std::int32_t kChunkCells = 64;
constexpr std::int32_t kChunkTriangles = 64;

std::size_t index(std::int64_t i) { return static_cast<std::size_t>(i); }

/// The projection of vertices [first, last), in float32. Written without branches, so that it is vectorised;
/// every operation is one IEEE operation, so that it gives the same bits with and without.
void project_range(const Projection& p, const Mesh& mesh, std::size_t first, std::size_t last,
                   ProjectedMesh& out) {
  float m[3][4];
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 4; ++j) m[i][j] = static_cast<float>(p.matrix[i][j]);
  }
  const auto w_scale = static_cast<float>(p.inverse_depth_scale);
  const auto w_offset = static_cast<float>(p.inverse_depth_offset);
  const auto centre_x = static_cast<float>(p.centre[0]);
  const auto centre_y = static_cast<float>(p.centre[1]);
  const auto out_x = static_cast<float>(p.centre_out[0]);
  const auto out_y = static_cast<float>(p.centre_out[1]);
  const auto clip = static_cast<float>(p.clip_depth);
  const auto limit = static_cast<float>(kMaxCoordinate);
  const float* const u = mesh.u.data();
  const float* const v = mesh.v.data();
  const float* const disparity = mesh.disparity.data();
  std::int32_t* const x = out.x.data();
  std::int32_t* const y = out.y.data();
  float* const q = out.q.data();
  float* const s = out.s.data();
  for (std::size_t i = first; i < last; ++i) {
    const float du = u[i] - centre_x;
    const float dv = v[i] - centre_y;
    const float d = disparity[i];
    const float w = w_scale * d + w_offset;
    const float hx = (m[0][0] * du + m[0][1] * dv) + (m[0][3] * d + m[0][2]);
    const float hy = (m[1][0] * du + m[1][1] * dv) + (m[1][3] * d + m[1][2]);
    const float hz = (m[2][0] * du + m[2][1] * dv) + (m[2][3] * d + m[2][2]);
    const float inverse = 1.0F / hz;
    const float sx = hx * inverse + out_x;
    const float sy = hy * inverse + out_y;
    const int good = static_cast<int>(hz >= clip * w) & static_cast<int>(std::abs(sx) <= limit) &
                     static_cast<int>(std::abs(sy) <= limit);
    const float fx = good != 0 ? sx * static_cast<float>(kSubpixels) : 0.0F;
    const float fy = good != 0 ? sy * static_cast<float>(kSubpixels) : 0.0F;
    x[i] = static_cast<std::int32_t>(fx + std::copysign(0.5F, fx));
    y[i] = static_cast<std::int32_t>(fy + std::copysign(0.5F, fy));
    q[i] = good != 0 ? w * inverse : ProjectedMesh::kClipped;
    s[i] = inverse;
  }
}

/// The bounds of vertices, gathered one by one.
struct Bounds {
  std::int32_t x0 = std::numeric_limits<std::int32_t>::max();
  std::int32_t y0 = x0;
  std::int32_t x1 = std::numeric_limits<std::int32_t>::min();
  std::int32_t y1 = x1;
  float q = std::numeric_limits<float>::infinity();

  void add(const ProjectedMesh& mesh, std::size_t i) {
    x0 = std::min(x0, mesh.x[i]);
    x1 = std::max(x1, mesh.x[i]);
    y0 = std::min(y0, mesh.y[i]);
    y1 = std::max(y1, mesh.y[i]);
    q = std::min(q, mesh.q[i]);
  }
  [[nodiscard]] Chunk chunk(std::int32_t first, std::int32_t last) const {
    return {first, last, first_centre(x0), first_centre(y0), last_centre(x1), last_centre(y1), !(q > 0.0F)};
  }
};

void bound_grid(const Mesh& mesh, ProjectedMesh& out) {
  const std::int32_t cells = mesh.grid_columns() - 1;
  const std::int32_t per_row = (cells + kChunkCells - 1) / kChunkCells;
  const auto columns = static_cast<std::int64_t>(mesh.grid_columns());
  const std::int64_t rows = mesh.grid_rows() - 1;
  out.chunks.resize(index(rows * per_row));
  parallel_for(rows, [&](std::int64_t row) {
    for (std::int32_t i = 0; i < per_row; ++i) {
      const std::int32_t first = i * kChunkCells;
      const std::int32_t last = std::min(first + kChunkCells, cells);
      Bounds bounds;
      for (std::int64_t c = first; c <= last; ++c) bounds.add(out, index(row * columns + c));
      for (std::int64_t c = first; c <= last; ++c) bounds.add(out, index((row + 1) * columns + c));
      out.chunks[index(row * per_row + i)] = bounds.chunk(first, last);
    }
  });
}

void bound_triangles(const Mesh& mesh, ProjectedMesh& out) {
  const auto count = static_cast<std::int32_t>(mesh.triangles.size());
  const std::int32_t chunks = (count + kChunkTriangles - 1) / kChunkTriangles;
  out.chunks.resize(index(chunks));
  constexpr std::int32_t kBlock = 64;
  parallel_for((chunks + kBlock - 1) / kBlock, [&](std::int64_t block) {
    const auto start = static_cast<std::int32_t>(block) * kBlock;
    for (std::int32_t i = start; i < std::min(start + kBlock, chunks); ++i) {
      const std::int32_t first = i * kChunkTriangles;
      const std::int32_t last = std::min(first + kChunkTriangles, count);
      Bounds bounds;
      for (std::int32_t t = first; t < last; ++t) {
        for (const std::uint32_t vertex : mesh.triangles[index(t)]) bounds.add(out, vertex);
      }
      out.chunks[index(i)] = bounds.chunk(first, last);
    }
  });
}

ScreenVertex screen_vertex(const Mesh& mesh, const ProjectedMesh& projected, std::size_t i) {
  const float s = projected.s[i];
  return {projected.x[i], projected.y[i], projected.q[i], s, mesh.u[i] * s, mesh.v[i] * s};
}

bool touches(const Chunk& chunk, const FragmentBand& band) {
  return chunk.clipped || (chunk.y0 < band.y1() && chunk.y1 >= band.y0() && chunk.x0 < band.width() &&
                           chunk.x1 >= 0 && chunk.x0 <= chunk.x1 && chunk.y0 <= chunk.y1);
}

/// Triangles [first, last), any of which may be clipped.
void draw_triangles(const Projection& projection, const Mesh& mesh, const ProjectedMesh& projected,
                    std::size_t first, std::size_t last, FragmentBand& band) {
  for (std::size_t t = first; t < last; ++t) {
    const auto [a, b, c] = mesh.triangle(t);
    if (std::min({projected.q[a], projected.q[b], projected.q[c]}) > 0.0F) {
      draw_triangle(screen_vertex(mesh, projected, a), screen_vertex(mesh, projected, b),
                    screen_vertex(mesh, projected, c), Faces::kFront, band);
    } else {
      draw_clipped_triangle(projection, mesh, projected, t, band);
    }
  }
}

void draw_grid_chunk(const Mesh& mesh, const ProjectedMesh& projected, std::int64_t row, const Chunk& chunk,
                     FragmentBand& band) {
  const std::size_t upper = index(row * mesh.grid_columns());
  const std::size_t lower = upper + index(mesh.grid_columns());
  const GridRow grid{{projected.x.data() + upper, projected.x.data() + lower},
                     {projected.y.data() + upper, projected.y.data() + lower},
                     {projected.q.data() + upper, projected.q.data() + lower},
                     {projected.s.data() + upper, projected.s.data() + lower},
                     mesh.u.data() + upper,
                     {mesh.v[upper], mesh.v[lower]},
                     static_cast<int>(row)};
  draw_cells(grid, chunk.first, chunk.last, band);
}

}  // namespace

Projection make_projection(const Camera& camera, const View& view, int width, int height) {
  const double scale = view_scale(camera, width, height);
  const double focal = camera.focal * view.zoom * scale;
  const glm::dvec2 centre = camera.centre();
  Projection p{};
  p.inverse_depth_offset = camera.inverse_depth(0.0);
  p.inverse_depth_scale = camera.inverse_depth(1.0) - p.inverse_depth_offset;
  for (int i = 0; i < 3; ++i) {
    const double to_pixels = i < 2 ? focal : 1.0;
    const auto rotation = [&](int j) { return view.pose.rotation[j][i]; };  // GLM stores columns
    p.matrix[i][0] = to_pixels / camera.focal * rotation(0);
    p.matrix[i][1] = to_pixels / camera.focal * rotation(1);
    p.matrix[i][2] = to_pixels * (rotation(2) + view.pose.translation[i] * p.inverse_depth_offset);
    p.matrix[i][3] = to_pixels * view.pose.translation[i] * p.inverse_depth_scale;
  }
  p.centre[0] = centre.x;
  p.centre[1] = centre.y;
  p.centre_out[0] = (width - 1) / 2.0 + view.shift.x * scale;
  p.centre_out[1] = (height - 1) / 2.0 + view.shift.y * scale;
  p.clip_depth = camera.clip_depth();
  return p;
}

void project_mesh(const Projection& projection, const Mesh& mesh, ProjectedMesh& out) {
  const std::size_t count = mesh.u.size();
  out.x.resize(count);
  out.y.resize(count);
  out.q.resize(count);
  out.s.resize(count);
  constexpr std::size_t kBlock = 8192;
  parallel_for(static_cast<std::int64_t>((count + kBlock - 1) / kBlock), [&](std::int64_t block) {
    const std::size_t first = index(block) * kBlock;
    project_range(projection, mesh, first, std::min(first + kBlock, count), out);
  });
  if (mesh.full) {
    bound_grid(mesh, out);
  } else {
    bound_triangles(mesh, out);
  }
}

void draw_mesh(const Projection& projection, const Mesh& mesh, const ProjectedMesh& projected,
               FragmentBand& band) {
  const std::size_t cells = index(mesh.grid_columns() - 1);
  const std::size_t per_row = (cells + kChunkCells - 1) / kChunkCells;
  for (std::size_t i = 0; i < projected.chunks.size(); ++i) {
    const Chunk& chunk = projected.chunks[i];
    if (!touches(chunk, band)) continue;
    const std::size_t row = mesh.full ? i / per_row : 0;
    const std::size_t per_cell = mesh.full ? 2 : 1;
    if (mesh.full && !chunk.clipped) {
      draw_grid_chunk(mesh, projected, static_cast<std::int64_t>(row), chunk, band);
    } else {
      const std::size_t start = mesh.full ? row * cells : 0;
      draw_triangles(projection, mesh, projected, (start + index(chunk.first)) * per_cell,
                     (start + index(chunk.last)) * per_cell, band);
    }
  }
}

}  // namespace slide
