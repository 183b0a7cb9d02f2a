#include "render/camera.h"

#include <doctest/doctest.h>

#include <cmath>
#include <limits>

#include "runtime/error.h"

namespace slide {

TEST_CASE("the default field of view makes the focal length equal to the width") {
  // tan(53.13 degrees / 2) is 1/2 to five digits: the angle of a 3-4-5 triangle.
  const Camera camera = make_camera(1000, 600);
  CHECK(camera.focal == doctest::Approx(1000.0).epsilon(1e-4));
  CHECK(make_camera(200, 100, 90.0).focal == doctest::Approx(100.0).epsilon(1e-12));
}

TEST_CASE("disparity 1 is near, 0 is far, and inverse depth is linear between them") {
  const Camera camera = make_camera(10, 10, 60.0, 2.0, 8.0);
  CHECK(1.0 / camera.inverse_depth(1.0) == doctest::Approx(2.0));
  CHECK(1.0 / camera.inverse_depth(0.0) == doctest::Approx(8.0));
  CHECK(camera.inverse_depth(0.5) == doctest::Approx((0.5 + 0.125) / 2));
}

TEST_CASE("a pixel is back-projected to its depth and seen again at its place") {
  const Camera camera = make_camera(641, 479, 70.0, 1.0, 10.0);
  for (const double d : {0.0, 0.3, 1.0}) {
    const glm::dvec3 point = back_project(camera, 17.25, 400.5, d);
    CHECK(point.z == doctest::Approx(1.0 / (d * 0.9 + 0.1)));
    const glm::dvec2 seen = project(camera, View{}, point);
    CHECK(seen.x == doctest::Approx(17.25).epsilon(1e-12));
    CHECK(seen.y == doctest::Approx(400.5).epsilon(1e-12));
  }
  const glm::dvec3 axis = back_project(camera, 320.0, 239.0, 0.0);
  CHECK(axis.x == 0.0);
  CHECK(axis.y == 0.0);
}

TEST_CASE("a view fills its picture and is cropped where the shapes differ") {
  const Camera camera = make_camera(400, 300);
  CHECK(view_scale(camera, 400, 300) == 1.0);
  CHECK(view_scale(camera, 800, 300) == 2.0);
  CHECK(view_scale(camera, 200, 300) == 1.0);
}

TEST_CASE("impossible cameras are refused") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK_THROWS_AS((void)make_camera(10, 10, 0.0), Error);
  CHECK_THROWS_AS((void)make_camera(10, 10, 180.0), Error);
  CHECK_THROWS_AS((void)make_camera(10, 10, nan), Error);
  CHECK_THROWS_AS((void)make_camera(10, 10, 50.0, 0.0, 1.0), Error);
  CHECK_THROWS_AS((void)make_camera(10, 10, 50.0, 2.0, 2.0), Error);
  CHECK_THROWS_AS((void)make_camera(10, 10, 50.0, 1.0, nan), Error);
  CHECK_THROWS_AS((void)make_camera(10, 10, 50.0, 1.0, std::numeric_limits<double>::infinity()), Error);
}

}  // namespace slide
