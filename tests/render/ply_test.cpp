#include "render/ply.h"

#include <doctest/doctest.h>

#include <cmath>
#include <cstring>

#include "runtime/error.h"

namespace {

struct Point {
  float x, y, z;
  std::uint8_t r, g, b;
};

/// The points of a file whose header is exactly the expected one.
std::vector<Point> points_of(const std::vector<std::uint8_t>& file, std::size_t count) {
  const std::string header = "ply\nformat binary_little_endian 1.0\ncomment SLIDE 3D photo\nelement vertex " +
                             std::to_string(count) +
                             "\nproperty float x\nproperty float y\nproperty float z\n"
                             "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
  REQUIRE(file.size() == header.size() + 15 * count);
  REQUIRE(std::string(file.begin(), file.begin() + static_cast<std::ptrdiff_t>(header.size())) == header);
  std::vector<Point> points(count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint8_t* at = file.data() + header.size() + 15 * i;
    std::memcpy(&points[i].x, at, 4);
    std::memcpy(&points[i].y, at + 4, 4);
    std::memcpy(&points[i].z, at + 8, 4);
    points[i].r = at[12];
    points[i].g = at[13];
    points[i].b = at[14];
  }
  return points;
}

slide::Layer flat(float disparity, float grey) {
  return {slide::Image(4, 3, 3, grey), slide::Image(4, 3, 1, disparity), {}};
}

}  // namespace

TEST_CASE("A point cloud has each pixel where the camera saw it, y up and the camera looking along -z") {
  slide::Layers layers;
  layers.foreground = flat(0.0F, 0.0F);
  layers.foreground.disparity.at(3, 0) = 1;
  layers.foreground.colour.at(3, 0, 1) = 1;
  // 90 degrees: the focal length is half the width.
  const std::vector<Point> points =
      points_of(slide::encode_ply(layers, slide::make_camera(4, 3, 90, 2, 8)), 12);
  // Pixel (3, 0) at depth 2: x = (3 - 1.5) 2/2, y = -(0 - 1) 2/2.
  CHECK(points[3].x == doctest::Approx(1.5));
  CHECK(points[3].y == doctest::Approx(1.0));
  CHECK(points[3].z == doctest::Approx(-2.0));
  CHECK((points[3].r == 0 && points[3].g == 255 && points[3].b == 0));
  // Pixel (0, 2) at depth 8.
  CHECK(points[8].x == doctest::Approx(-6.0));
  CHECK(points[8].y == doctest::Approx(-4.0));
  CHECK(points[8].z == doctest::Approx(-8.0));
}

TEST_CASE("Of the background come the points that the foreground does not have") {
  slide::Layers layers;
  layers.foreground = flat(0.5F, 1.0F);
  layers.foreground.alpha = slide::Image(4, 3, 1, 1.0F);
  layers.foreground.alpha.at(1, 1) = 0.25F;
  layers.background = flat(0.5F, 0.2F);
  layers.background->disparity.at(2, 1) = 0.1F;
  const std::vector<Point> points = points_of(slide::encode_ply(layers, slide::make_camera(4, 3)), 11 + 2);
  CHECK(points[10].r == 255);
  CHECK(points[11].r == 51);  // behind (1, 1)
  CHECK(points[12].r == 51);  // behind (2, 1)
  CHECK(points[12].z < points[11].z);
}
