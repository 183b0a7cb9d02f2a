#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "render/projection.h"

namespace slide {
namespace {

/// A vertex before the division: the point, its inverse depth in the photo and its place there, all in
/// float64 and all linear along an edge.
struct ClipVertex {
  double x, y, z;  ///< x and y relative to the screen's origin, so that the screen position is (x, y) / z
  double w, u, v;
  bool projected;  ///< has been projected, and so is inside by decree
  ScreenVertex screen;
};

/// Five planes add a corner each to the three.
struct Polygon {
  std::array<ClipVertex, 8> corners;
  std::size_t size = 0;
  void add(const ClipVertex& v) { corners[size++] = v; }
};

ClipVertex clip_vertex(const Projection& p, const Mesh& mesh, const ProjectedMesh& projected, std::size_t i) {
  const double point[4] = {mesh.u[i] - p.centre[0], mesh.v[i] - p.centre[1], 1.0, mesh.disparity[i]};
  double h[3];
  for (int row = 0; row < 3; ++row) {
    h[row] = 0.0;
    for (int j = 0; j < 4; ++j) h[row] += p.matrix[row][j] * point[j];
  }
  ClipVertex vertex{};
  vertex.x = h[0] + p.centre_out[0] * h[2];
  vertex.y = h[1] + p.centre_out[1] * h[2];
  vertex.z = h[2];
  vertex.w = p.inverse_depth_scale * point[3] + p.inverse_depth_offset;
  vertex.u = mesh.u[i];
  vertex.v = mesh.v[i];
  vertex.projected = projected.q[i] > 0.0F;
  if (vertex.projected) {
    const float s = projected.s[i];
    vertex.screen = {projected.x[i], projected.y[i], projected.q[i], s, mesh.u[i] * s, mesh.v[i] * s};
  }
  return vertex;
}

ClipVertex between(const ClipVertex& a, const ClipVertex& b, double t) {
  ClipVertex r{};
  r.x = a.x + t * (b.x - a.x);
  r.y = a.y + t * (b.y - a.y);
  r.z = a.z + t * (b.z - a.z);
  r.w = a.w + t * (b.w - a.w);
  r.u = a.u + t * (b.u - a.u);
  r.v = a.v + t * (b.v - a.v);
  return r;
}

/// Keeps the part of a polygon where distance(vertex), a linear function, is not negative.
template <typename Distance>
Polygon clip(const Polygon& polygon, const Distance& distance) {
  // A vertex that was projected in float32 may be outside by a rounding; other triangles use it, so it stays.
  const auto signed_distance = [&](const ClipVertex& v) {
    const double d = distance(v);
    return v.projected ? std::max(d, 0.0) : d;
  };
  Polygon result;
  for (std::size_t i = 0; i < polygon.size; ++i) {
    const ClipVertex& a = polygon.corners[i];
    const ClipVertex& b = polygon.corners[(i + 1) % polygon.size];
    const double da = signed_distance(a);
    const double db = signed_distance(b);
    if (da >= 0.0) result.add(a);
    if (da >= 0.0 && db < 0.0) result.add(between(a, b, da / (da - db)));
    if (da < 0.0 && db >= 0.0) result.add(between(b, a, db / (db - da)));
  }
  return result;
}

std::int32_t to_fixed(double pixels) {
  const double largest = kMaxCoordinate;
  return static_cast<std::int32_t>(std::round(std::clamp(pixels, -largest, largest) * kSubpixels));
}

ScreenVertex to_screen(const ClipVertex& v) {
  if (v.projected) return v.screen;
  return {to_fixed(v.x / v.z),           to_fixed(v.y / v.z),           static_cast<float>(v.w / v.z),
          static_cast<float>(1.0 / v.z), static_cast<float>(v.u / v.z), static_cast<float>(v.v / v.z)};
}

}  // namespace

void draw_clipped_triangle(const Projection& projection, const Mesh& mesh, const ProjectedMesh& projected,
                           std::size_t triangle, FragmentBand& band) {
  Polygon polygon;
  for (const std::uint32_t i : mesh.triangle(triangle))
    polygon.add(clip_vertex(projection, mesh, projected, i));
  const double limit = kMaxCoordinate;
  polygon = clip(polygon, [&](const ClipVertex& v) { return v.z - projection.clip_depth * v.w; });
  polygon = clip(polygon, [&](const ClipVertex& v) { return limit * v.z - v.x; });
  polygon = clip(polygon, [&](const ClipVertex& v) { return limit * v.z + v.x; });
  polygon = clip(polygon, [&](const ClipVertex& v) { return limit * v.z - v.y; });
  polygon = clip(polygon, [&](const ClipVertex& v) { return limit * v.z + v.y; });
  for (std::size_t i = 2; i < polygon.size; ++i) {
    draw_triangle(to_screen(polygon.corners[0]), to_screen(polygon.corners[i - 1]),
                  to_screen(polygon.corners[i]), Faces::kFront, band);
  }
}

}  // namespace slide
