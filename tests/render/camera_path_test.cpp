#include "render/camera_path.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <limits>
#include <string>

#include "runtime/error.h"

namespace slide {
namespace {

/// P by its definition: the pixel of disparity 1 against that of disparity 0, at every pixel of a photo.
double parallax_by_definition(const Camera& camera, const std::vector<View>& views) {
  double largest = 0.0;
  for (const View& view : views) {
    for (int y = 0; y < camera.height; ++y) {
      for (int x = 0; x < camera.width; ++x) {
        const glm::dvec2 near = project(camera, view, back_project(camera, x, y, 1.0));
        const glm::dvec2 far = project(camera, view, back_project(camera, x, y, 0.0));
        largest = std::max(largest, glm::length(near - far));
      }
    }
  }
  return largest;
}

/// The largest displacement per disparity between neighbouring disparities, at every pixel.
double rate_by_differences(const Camera& camera, const std::vector<View>& views) {
  constexpr int kSteps = 64;
  double largest = 0.0;
  for (const View& view : views) {
    for (int y = 0; y < camera.height; y += 3) {
      for (int x = 0; x < camera.width; ++x) {
        for (int i = 0; i < kSteps; ++i) {
          const glm::dvec2 a = project(camera, view, back_project(camera, x, y, double(i) / kSteps));
          const glm::dvec2 b = project(camera, view, back_project(camera, x, y, double(i + 1) / kSteps));
          largest = std::max(largest, glm::length(a - b) * kSteps);
        }
      }
    }
  }
  return largest;
}

View rotated_view(double degrees, const glm::dvec3& axis, const glm::dvec3& translation) {
  View view;
  view.pose.rotation =
      glm::dmat3(glm::rotate(glm::dmat4(1.0), degrees * 3.14159265358979 / 180.0, glm::normalize(axis)));
  view.pose.translation = translation;
  return view;
}

PathOptions path(PathKind kind, double percent, double focus = 0.5, int frames = 12) {
  return {kind, percent, focus, frames};
}

}  // namespace

TEST_CASE("P of every built-in path is the parallax asked for, and what its definition gives") {
  const Camera camera = make_camera(61, 45);
  for (const PathKind kind : {PathKind::kCircle, PathKind::kSwing, PathKind::kZoom, PathKind::kDollyZoom}) {
    for (const double percent : {0.5, 4.0, 20.0}) {
      CAPTURE(static_cast<int>(kind));
      CAPTURE(percent);
      const std::vector<View> views = make_path(camera, path(kind, percent));
      const double parallax = largest_parallax(camera, views);
      CHECK(parallax == doctest::Approx(percent / 100.0 * 61.0).epsilon(2e-6));
      CHECK(parallax == doctest::Approx(parallax_by_definition(camera, views)).epsilon(2e-6));
    }
  }
}

TEST_CASE("P of rotated views is what its definition gives over a dense photo") {
  const Camera camera = make_camera(161, 121, 60.0);
  const std::vector<View> all = {
      rotated_view(5.0, {0, 1, 0}, {0.1, 0.0, 0.0}),
      rotated_view(-12.0, {0.2, 1, 0.4}, {0.05, -0.08, 0.1}),
      rotated_view(25.0, {1, 0.3, -0.5}, {0, 0.1, 0.2}),
      rotated_view(40.0, {0, 0, 1}, {0.02, 0.03, -0.3}),
      rotated_view(30.0, {0, 1, 0}, {0.0, 0.0, 0.0}),
  };
  for (const View& view : all) {
    const double exact = largest_parallax(camera, {view});
    const double dense = parallax_by_definition(camera, {view});
    CHECK(exact >= dense * (1.0 - 1e-12) - 1e-12);
    // Where the maximum is inside, it is flat there; where it is at the outline, it is at a corner or nearly
    // so.
    CHECK(exact <= dense * (1.0 + 1e-3) + 1e-9);
  }
  CHECK(largest_parallax(camera, all) >= largest_parallax(camera, {all[1]}));
}

TEST_CASE("a panorama's parallax follows its height, other photos' their width") {
  const auto parallax = [](int width, int height) {
    const Camera camera = make_camera(width, height);
    return largest_parallax(camera, make_path(camera, {.kind = PathKind::kSwing, .frames = 4}));
  };
  CHECK(parallax(1536, 192) == doctest::Approx(0.04 * 384).epsilon(1e-6));
  CHECK(parallax(1536, 768) == doctest::Approx(0.04 * 1536).epsilon(1e-6));
  CHECK(parallax(1600, 900) == doctest::Approx(0.04 * 1600).epsilon(1e-6));
  CHECK(parallax(192, 1536) == doctest::Approx(0.04 * 192).epsilon(1e-6));
}

TEST_CASE("the parallax rate is what differences between disparities approach") {
  const Camera camera = make_camera(41, 31);
  for (const View& view :
       {rotated_view(10.0, {0.1, 1, 0}, {0.1, 0.05, -0.2}), rotated_view(3.0, {1, 0, 0}, {0.0, 0.0, -0.4}),
        rotated_view(0.0, {1, 0, 0}, {0.2, 0, 0})}) {
    const double rate = largest_parallax_rate(camera, {view});
    const double differences = rate_by_differences(camera, {view});
    CHECK(rate >= differences * (1.0 - 1e-9));
    CHECK(rate <= differences * 1.02);
    CHECK(rate >= largest_parallax(camera, {view}) * (1.0 - 1e-5));
  }
}

TEST_CASE("sideways paths have the same parallax everywhere, and their rate is P") {
  const Camera camera = make_camera(672, 1008);
  const std::vector<View> views = make_path(camera, path(PathKind::kCircle, 4.0));
  CHECK(largest_parallax(camera, views) == doctest::Approx(26.88).epsilon(1e-6));
  CHECK(largest_parallax_rate(camera, views) == doctest::Approx(26.88).epsilon(1e-6));
}

TEST_CASE("the focused disparity stands still in the whole picture") {
  const Camera camera = make_camera(320, 240);
  for (const PathKind kind : {PathKind::kCircle, PathKind::kSwing, PathKind::kDollyZoom}) {
    for (const double focus : {0.0, 0.35, 1.0}) {
      for (const View& view : make_path(camera, path(kind, 5.0, focus))) {
        for (const double x : {0.0, 100.5, 319.0}) {
          const glm::dvec2 seen = project(camera, view, back_project(camera, x, 200.0, focus));
          CHECK(seen.x == doctest::Approx(x).epsilon(1e-9));
          CHECK(seen.y == doctest::Approx(200.0).epsilon(1e-9));
        }
      }
    }
  }
}

TEST_CASE("swing, zoom and dolly zoom begin where the photo was taken") {
  const Camera camera = make_camera(320, 240);
  for (const PathKind kind : {PathKind::kSwing, PathKind::kZoom, PathKind::kDollyZoom}) {
    const View first = make_path(camera, path(kind, 4.0)).front();
    const glm::dvec2 seen = project(camera, first, back_project(camera, 12.0, 34.0, 0.8));
    CHECK(seen.x == doctest::Approx(12.0));
    CHECK(seen.y == doctest::Approx(34.0));
  }
}

TEST_CASE("a scene that comes behind the camera counts as moved by the photo's diagonal") {
  const Camera camera = make_camera(30, 40);
  const View through = rotated_view(0.0, {0, 0, 1}, {0, 0, -2.0});
  const View away = rotated_view(180.0, {0, 1, 0}, {0.1, 0, 0});
  CHECK(largest_parallax(camera, {through}) == doctest::Approx(50.0));
  CHECK(largest_parallax(camera, {away}) == doctest::Approx(50.0));
  CHECK(largest_parallax_rate(camera, {through}) == std::numeric_limits<double>::infinity());
}

TEST_CASE("paths that cannot be are refused") {
  const Camera camera = make_camera(320, 240);
  CHECK_THROWS_AS((void)make_path(camera, path(PathKind::kCircle, -1.0)), Error);
  CHECK_THROWS_AS((void)make_path(camera, path(PathKind::kCircle, 51.0)), Error);
  CHECK_THROWS_AS((void)make_path(camera, path(PathKind::kCircle, std::numeric_limits<double>::quiet_NaN())),
                  Error);
  CHECK_THROWS_AS((void)make_path(camera, path(PathKind::kCircle, 4.0, 1.5)), Error);
  CHECK_THROWS_AS((void)make_path(camera, path(PathKind::kCircle, 4.0, 0.5, 0)), Error);
  CHECK_THROWS_AS((void)path_kind("spiral"), Error);
  CHECK(path_kind("dolly-zoom") == PathKind::kDollyZoom);
}

TEST_CASE("the eyes of a view are a swing's ends, about any view, and the focus stands still between them") {
  const Camera camera = make_camera(400, 300);
  const std::vector<View> path = make_path(camera, {.kind = PathKind::kCircle, .frames = 5});
  View turned;  // by 0.1 about y, zoomed
  turned.pose.rotation =
      glm::dmat3(std::cos(0.1), 0, -std::sin(0.1), 0, 1, 0, std::sin(0.1), 0, std::cos(0.1));
  turned.zoom = 1.5;
  const std::vector<Eyes> eyes = eyes_of(camera, {View(), path[2], turned}, 3, 0.25);
  REQUIRE(eyes.size() == 3);
  const auto apart = [&](const Eyes& pair, const glm::dvec3& point) {
    return project(camera, pair.left, point).x - project(camera, pair.right, point).x;
  };
  // P of each eye is 3 % of 400 pixels between disparities 0 and 1: 24 between the eyes, none at 0.25.
  for (std::size_t i = 0; i < 2; ++i) {
    CHECK(std::abs(apart(eyes[i], back_project(camera, 120, 80, 0.25))) < 1e-9);
    CHECK(apart(eyes[i], back_project(camera, 120, 80, 1)) == doctest::Approx(24 * 0.75));
    CHECK(apart(eyes[i], back_project(camera, 120, 80, 0)) == doctest::Approx(-24 * 0.25));
  }
  // Along the turned camera's own axis, zoomed: a point at z in front of it is f·zoom·2a (1/z - 1/z0) apart.
  const double amplitude = 12 / (camera.focal * 0.9);
  const glm::dvec3 seen{0.2, -0.1, 2.5};
  CHECK(apart(eyes[2], glm::transpose(turned.pose.rotation) * seen) ==
        doctest::Approx(camera.focal * 1.5 * 2 * amplitude * (1 / 2.5 - camera.inverse_depth(0.25))));
  CHECK_THROWS_AS((void)eyes_of(camera, {View()}, 60, 0.5), Error);
}

}  // namespace slide
