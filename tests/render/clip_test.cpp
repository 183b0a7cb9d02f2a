#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/matrix.hpp>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "render/projection.h"

namespace slide {
namespace {

constexpr int kWidth = 48;
constexpr int kHeight = 40;

View moved_view(double degrees, const glm::dvec3& axis, const glm::dvec3& translation) {
  View view;
  view.pose.rotation =
      glm::dmat3(glm::rotate(glm::dmat4(1.0), degrees * 3.14159265358979 / 180.0, glm::normalize(axis)));
  view.pose.translation = translation;
  return view;
}

/// What a ray of a view hits.
struct Hit {
  std::size_t triangle;
  double inverse_depth;
  double u, v;
};

struct Scene {
  Camera camera;
  View view;
  Mesh mesh;

  [[nodiscard]] glm::dvec3 vertex(std::uint32_t i) const {
    return view.pose.rotation * back_project(camera, mesh.u[i], mesh.v[i], mesh.disparity[i]) +
           view.pose.translation;
  }

  /// The nearest front face beyond the clip depth, by intersecting the ray through a place of the view, drawn
  /// at kWidth × kHeight, with every triangle in space.
  [[nodiscard]] std::optional<Hit> hit(double x, double y) const {
    const double focal = camera.focal * view.zoom * view_scale(camera, kWidth, kHeight);
    const glm::dvec3 ray((x - (kWidth - 1) / 2.0) / focal, (y - (kHeight - 1) / 2.0) / focal, 1.0);
    std::optional<Hit> nearest;
    for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
      const auto t = mesh.triangle(i);
      const glm::dvec3 a = vertex(t[0]);
      const glm::dvec3 b = vertex(t[1]);
      const glm::dvec3 c = vertex(t[2]);
      // Cramer's rule for ray = ga a + gb b + gc c: the point ray / (ga + gb + gc) is in the triangle if no
      // weight is negative. The volume is positive for triangles that turn clockwise as seen from the origin.
      const double volume = glm::dot(a, glm::cross(b, c));
      const double ga = glm::dot(ray, glm::cross(b, c)) / volume;
      const double gb = glm::dot(a, glm::cross(ray, c)) / volume;
      const double gc = glm::dot(a, glm::cross(b, ray)) / volume;
      const double inverse_depth = ga + gb + gc;
      if (!(volume > 0.0) || std::min({ga, gb, gc}) < 0.0 || inverse_depth * camera.clip_depth() > 1.0)
        continue;
      if (nearest && nearest->inverse_depth >= inverse_depth) continue;
      const glm::dvec3 point =
          glm::transpose(view.pose.rotation) * (ray / inverse_depth - view.pose.translation);
      const glm::dvec2 place = camera.centre() + glm::dvec2(point.x, point.y) * (camera.focal / point.z);
      nearest = Hit{i, inverse_depth, place.x, place.y};
    }
    return nearest;
  }
};

Scene scene_of(const View& view, const Image& disparity) {
  return {make_camera(disparity.width, disparity.height, 80.0), view, full_mesh(disparity)};
}

/// The scene's vertices on the screen.
struct Drawing {
  explicit Drawing(const Scene& scene)
      : projection(make_projection(scene.camera, scene.view, kWidth, kHeight)) {
    project_mesh(projection, scene.mesh, projected);
  }
  [[nodiscard]] bool has_clipped() const {
    return *std::min_element(projected.q.begin(), projected.q.end()) < 0.0F;
  }
  Projection projection;
  ProjectedMesh projected;
};

/// Views from inside the scene, parts of which are behind them.
std::vector<View> views_inside() {
  return {moved_view(0.0, {0, 0, 1}, {0.0, 0.0, -1.5}), moved_view(50.0, {0, 1, 0}, {0.2, 0.1, -0.2}),
          moved_view(-50.0, {1, 0.4, 0.3}, {0.0, 0.3, -0.1}), moved_view(65.0, {0.2, 1, 0}, {-0.6, 0.0, 0.2}),
          moved_view(-60.0, {1, 0, 0.1}, {0.1, 0.0, -0.3})};
}

/// What the four rays beside a pixel's hit, if all hit the same triangle or all miss. Rounding to 1/256 pixel
/// moves a triangle's plane by less than that, and attributes are monotone across it: what is drawn lies
/// between these.
struct Surroundings {
  bool settled = true;
  std::optional<Hit> low, high;
};

Surroundings surroundings(const Scene& scene, int x, int y) {
  constexpr double kMargin = 1.0 / 256.0;
  Surroundings result;
  result.low = result.high = scene.hit(x - kMargin, y - kMargin);
  for (const auto& [dx, dy] : {std::pair{1, -1}, {-1, 1}, {1, 1}}) {
    const std::optional<Hit> hit = scene.hit(x + dx * kMargin, y + dy * kMargin);
    if (hit.has_value() != result.low.has_value() || (hit && hit->triangle != result.low->triangle)) {
      result.settled = false;
      break;
    }
    if (!hit) continue;
    *result.low = {hit->triangle, std::min(result.low->inverse_depth, hit->inverse_depth),
                   std::min(result.low->u, hit->u), std::min(result.low->v, hit->v)};
    *result.high = {hit->triangle, std::max(result.high->inverse_depth, hit->inverse_depth),
                    std::max(result.high->u, hit->u), std::max(result.high->v, hit->v)};
  }
  return result;
}

/// Of each pixel that is settled: is it drawn as rays find it?
struct Comparison {
  int settled = 0;
  int wrong = 0;
};

Comparison compare_with_rays(const Scene& scene) {
  const Drawing drawing(scene);
  FragmentBand band;
  band.reset(kWidth, 0, kHeight);
  draw_mesh(drawing.projection, scene.mesh, drawing.projected, band);
  Comparison result;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = y % 2; x < kWidth; x += 2) {
      const Surroundings around = surroundings(scene, x, y);
      if (!around.settled) continue;
      ++result.settled;
      const auto q = double(band.q(y)[x]);
      const auto s = double(band.s(y)[x]);
      if (!around.low) {
        result.wrong += q > 0.0 ? 1 : 0;
        continue;
      }
      const auto between = [](double low, double value, double high) {
        return value >= low - 1e-4 && value <= high + 1e-4;
      };
      const bool right = between(around.low->inverse_depth, q, around.high->inverse_depth) &&
                         between(around.low->u, double(band.us(y)[x]) / s, around.high->u) &&
                         between(around.low->v, double(band.vs(y)[x]) / s, around.high->v);
      result.wrong += right ? 0 : 1;
    }
  }
  return result;
}

/// How often each pixel is drawn when every triangle is drawn on its own.
std::vector<int> coverage_counts(const Scene& scene) {
  const Drawing drawing(scene);
  std::vector<int> counts(static_cast<std::size_t>(kWidth * kHeight), 0);
  FragmentBand band;
  for (std::size_t i = 0; i < scene.mesh.triangle_count(); ++i) {
    Mesh single = scene.mesh;
    single.full = false;
    single.triangles = {scene.mesh.triangle(i)};
    ProjectedMesh projected;
    project_mesh(drawing.projection, single, projected);
    band.reset(kWidth, 0, kHeight);
    draw_mesh(drawing.projection, single, projected, band);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        counts[static_cast<std::size_t>(y * kWidth + x)] += band.q(y)[x] > 0.0F ? 1 : 0;
      }
    }
  }
  return counts;
}

}  // namespace

TEST_CASE("a mesh that passes behind the camera is drawn as rays find it") {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> value(0.0F, 1.0F);
  int settled = 0;
  for (const View& view : views_inside()) {
    Image disparity(9, 8, 1);
    for (float& d : disparity.data) d = value(random);
    const Scene scene = scene_of(view, disparity);
    CHECK(Drawing(scene).has_clipped());
    const Comparison result = compare_with_rays(scene);
    CHECK(result.wrong == 0);
    settled += result.settled;
  }
  CHECK(settled > 5 * kWidth * kHeight / 2 * 8 / 10);
}

TEST_CASE("every pixel of a clipped plane is drawn by exactly one triangle") {
  std::vector<View> views = views_inside();
  views.erase(views.begin());  // has the whole plane behind it
  for (const View& view : views) {
    const Scene scene = scene_of(view, Image(11, 9, 1, 0.9F));
    CHECK(Drawing(scene).has_clipped());
    const std::vector<int> counts = coverage_counts(scene);
    int inside = 0;
    int wrong = 0;
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        // Not only what is settled: between the plane's triangles, each pixel belongs to one of them.
        const bool surrounded = scene.hit(x - 0.01, y - 0.01) && scene.hit(x + 0.01, y - 0.01) &&
                                scene.hit(x - 0.01, y + 0.01) && scene.hit(x + 0.01, y + 0.01);
        const int count = counts[static_cast<std::size_t>(y * kWidth + x)];
        inside += surrounded ? 1 : 0;
        wrong += count > 1 || (surrounded && count != 1) ? 1 : 0;
      }
    }
    CHECK(wrong == 0);
    CHECK(inside > 50);
  }
}

}  // namespace slide
