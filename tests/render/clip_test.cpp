#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/matrix.hpp>
#include <optional>
#include <random>
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

/// What a view's pixel sees of a mesh, by intersecting its ray with every triangle in space.
struct Hit {
  std::size_t triangle;
  double depth;
  double u, v;
};

struct Scene {
  Camera camera;
  View view;
  Mesh mesh;

  [[nodiscard]] glm::dvec3 vertex(std::uint32_t i) const {
    return view.pose.rotation * back_project(camera, mesh.u[i], mesh.v[i], mesh.disparity[i]) + view.pose.translation;
  }

  /// The nearest front face beyond the clip depth on the ray through a place of the view.
  [[nodiscard]] std::optional<Hit> hit(double x, double y) const {
    const glm::dvec2 p = (glm::dvec2(x, y) - camera.centre()) / camera.focal;
    const glm::dvec3 ray(p, 1.0);
    std::optional<Hit> nearest;
    for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
      const auto t = mesh.triangle(i);
      const glm::dvec3 a = vertex(t[0]);
      const glm::dvec3 b = vertex(t[1]);
      const glm::dvec3 c = vertex(t[2]);
      // Cramer's rule for s ray = ga a + gb b + gc c with positive g: the ray is inside the cone of the triangle.
      const double volume = glm::dot(a, glm::cross(b, c));
      const double ga = glm::dot(ray, glm::cross(b, c)) / volume;
      const double gb = glm::dot(a, glm::cross(ray, c)) / volume;
      const double gc = glm::dot(a, glm::cross(b, ray)) / volume;
      const double sum = ga + gb + gc;
      if (!(volume > 0.0) || sum == 0.0) continue;
      const double depth = 1.0 / sum;
      if (ga * depth < 0.0 || gb * depth < 0.0 || gc * depth < 0.0 || depth < camera.clip_depth()) continue;
      if (nearest && nearest->depth <= depth) continue;
      const glm::dvec3 point = glm::transpose(view.pose.rotation) * (ray * depth - view.pose.translation);
      nearest = Hit{i, depth, point.x / point.z * camera.focal + camera.centre().x,
                    point.y / point.z * camera.focal + camera.centre().y};
    }
    return nearest;
  }

  /// The hit at a pixel, if the ray is farther from any edge than coordinates are rounded.
  [[nodiscard]] bool settled(int x, int y, std::optional<Hit>& result) const {
    result = hit(x, y);
    constexpr double kMargin = 1.0 / 64.0;
    for (const auto& [dx, dy] : {std::pair{-1, -1}, {1, -1}, {-1, 1}, {1, 1}}) {
      const std::optional<Hit> beside = hit(x + dx * kMargin, y + dy * kMargin);
      if (beside.has_value() != result.has_value() || (beside && beside->triangle != result->triangle)) return false;
    }
    return true;
  }
};

Scene random_scene(const View& view, unsigned seed, bool flat) {
  Image disparity(9, 8, 1, 0.9F);
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> value(0.0F, 1.0F);
  if (!flat) {
    for (float& d : disparity.data) d = value(random);
  }
  return {make_camera(9, 8, 80.0), view, full_mesh(disparity)};
}

/// The scene's camera, its view drawn at kWidth × kHeight.
struct Drawing {
  explicit Drawing(const Scene& scene) : projection(make_projection(scene.camera, scene.view, kWidth, kHeight)) {
    project_mesh(projection, scene.mesh, projected);
  }
  Projection projection;
  ProjectedMesh projected;
};

/// From the drawing's pixels to those of the photo's size, which Scene::hit() takes.
glm::dvec2 in_photo_size(const Camera& camera, int x, int y) {
  const double scale = view_scale(camera, kWidth, kHeight);
  return camera.centre() + (glm::dvec2(x, y) - glm::dvec2((kWidth - 1) / 2.0, (kHeight - 1) / 2.0)) / scale;
}

std::vector<View> views_inside() {
  return {moved_view(0.0, {0, 0, 1}, {0.0, 0.0, -1.5}), moved_view(50.0, {0, 1, 0}, {0.2, 0.1, -1.0}),
          moved_view(-40.0, {1, 0.4, 0.3}, {0.0, 0.5, -0.9}), moved_view(80.0, {0.2, 1, 0}, {0.0, 0.0, -0.6}),
          moved_view(100.0, {1, 0, 0.1}, {0.1, 0.0, 0.3})};
}

}  // namespace

TEST_CASE("a mesh that passes behind the camera is drawn as rays find it") {
  int compared = 0;
  int clipped_scenes = 0;
  for (unsigned seed = 1; seed <= 2; ++seed) {
    for (const View& view : views_inside()) {
      const Scene scene = random_scene(view, seed, false);
      const Drawing drawing(scene);
      clipped_scenes += *std::min_element(drawing.projected.q.begin(), drawing.projected.q.end()) < 0.0F ? 1 : 0;
      FragmentBand band;
      band.reset(kWidth, 0, kHeight);
      draw_mesh(drawing.projection, scene.mesh, drawing.projected, band);
      int wrong = 0;
      for (int y = 0; y < kHeight; y += 2) {
        for (int x = 0; x < kWidth; x += 2) {
          std::optional<Hit> hit;
          const glm::dvec2 place = in_photo_size(scene.camera, x, y);
          Scene scaled = scene;
          if (!scaled.settled(0, 0, hit) && false) continue;
          hit = scene.hit(place.x, place.y);
          bool settled = true;
          for (const auto& [dx, dy] : {std::pair{-1, -1}, {1, -1}, {-1, 1}, {1, 1}}) {
            const auto beside = scene.hit(place.x + dx / 256.0, place.y + dy / 256.0);
            settled = settled && beside.has_value() == hit.has_value() && (!beside || beside->triangle == hit->triangle);
          }
          if (!settled) continue;
          ++compared;
          const float q = band.q(y)[x];
          if (!hit) {
            wrong += q > 0.0F ? 1 : 0;
            continue;
          }
          const double u = double(band.uq(y)[x]) / double(q);
          const double v = double(band.vq(y)[x]) / double(q);
          wrong += std::abs(1.0 / double(q) / hit->depth - 1.0) < 0.02 && std::abs(u - hit->u) < 0.05 &&
                           std::abs(v - hit->v) < 0.05
                       ? 0
                       : 1;
        }
      }
      CHECK(wrong == 0);
    }
  }
  CHECK(compared > 2500);
  CHECK(clipped_scenes >= 6);
}

}  // namespace slide
