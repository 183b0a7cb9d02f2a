#include "render/photo_layers.h"

#include <doctest/doctest.h>

#include <limits>

#include "runtime/error.h"

using namespace slide;

namespace {

Image numbered(int width, int height, int channels) {
  Image image(width, height, channels);
  for (std::size_t i = 0; i < image.data.size(); ++i) image.data[i] = static_cast<float>(i);
  return image;
}

}  // namespace

TEST_CASE("an image survives the way to a tensor and back, and channels become planes") {
  const Image image = numbered(5, 4, 3);
  const Tensor t = tensor_from_image(image);
  CHECK(t.shape() == Shape{1, 3, 4, 5});
  CHECK(t.data<float>()[20] == 1.0F);  // channel 1 of pixel 0
  CHECK(image_from_tensor(t).data == image.data);
}

TEST_CASE(
    "shrinking averages the covered area: a mean is kept, a constant stays, a half-covered pixel counts "
    "half") {
  const Image image = numbered(6, 4, 1);
  const Image half = shrink_to(image, 3);
  REQUIRE((half.width == 3 && half.height == 2));
  CHECK(half.at(0, 0) == doctest::Approx((0 + 1 + 6 + 7) / 4.0));
  Image row(3, 1, 1);
  row.data = {0, 1, 4};
  const Image two = shrink_to(row, 2);
  CHECK(two.at(0, 0) == doctest::Approx((0 + 0.5 * 1) / 1.5));
  CHECK(two.at(1, 0) == doctest::Approx((0.5 * 1 + 4) / 1.5));
  CHECK(shrink_to(image, 6).data == image.data);
}

TEST_CASE("depth becomes its inverse, infinitely far is 0, and a negative depth is refused with its place") {
  Image depth(2, 2, 1, 4.0F);
  depth.at(1, 0) = 2;
  depth.at(0, 1) = std::numeric_limits<float>::infinity();
  const Tensor disparity = disparity_from_map(depth, DepthKind::kDepth, 2, 2, "depth.png");
  CHECK(disparity.data<float>()[0] == 0.25F);
  CHECK(disparity.data<float>()[1] == 0.5F);
  CHECK(disparity.data<float>()[2] == 0.0F);
  depth.at(0, 1) = -1;
  CHECK_THROWS_WITH_AS((void)disparity_from_map(depth, DepthKind::kDepth, 2, 2, "depth.png"),
                       doctest::Contains("depth.png: the depth at pixel (0, 1)"), Error);
  CHECK_THROWS_WITH_AS((void)disparity_from_map(Image(2, 2, 1, std::numeric_limits<float>::infinity()),
                                                DepthKind::kDisparity, 2, 2, "d.pfm"),
                       doctest::Contains("d.pfm: the disparity at pixel (0, 0) is infinite"), Error);
}

TEST_CASE("missing values are NaN, and 0 in distances; they are continued from around in disparity") {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  Image depth(8, 8, 1);
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 8; ++x) depth.at(x, y) = x < 4 ? 2.0F : 8.0F;
  depth.at(1, 2) = 0;
  depth.at(6, 5) = nan;
  CHECK(missing_values(depth, DepthKind::kDepth) == 2);
  CHECK(missing_values(depth, DepthKind::kDisparity) == 1);
  const Tensor d = disparity_from_map(depth, DepthKind::kDepth, 8, 8, "depth.png");
  // Within a constant surface a hole gets that surface's value; known values are untouched.
  CHECK(d.data<float>()[2 * 8 + 1] == doctest::Approx(0.5));
  CHECK(d.data<float>()[5 * 8 + 6] == doctest::Approx(0.125));
  CHECK(d.data<float>()[0] == 0.5F);
  CHECK(d.data<float>()[63] == 0.125F);
  // Across a jump the values lie between those of both sides, in each row.
  for (int x = 2; x < 6; ++x) depth.at(x, 4) = 0;
  const Tensor across = disparity_from_map(depth, DepthKind::kDepth, 8, 8, "depth.png");
  for (std::size_t x = 2; x < 6; ++x) {
    CHECK(across.data<float>()[4 * 8 + x] >= 0.125F);
    CHECK(across.data<float>()[4 * 8 + x] <= 0.5F);
  }
  // 0 is a disparity like any other.
  Image zeros(2, 1, 1);
  zeros.data = {0, 1};
  CHECK(disparity_from_map(zeros, DepthKind::kDisparity, 2, 1, "d").data<float>()[0] == 0.0F);
  CHECK_THROWS_WITH_AS((void)disparity_from_map(Image(2, 2, 1, nan), DepthKind::kDisparity, 2, 2, "d.pfm"),
                       doctest::Contains("d.pfm holds no value"), Error);
}

TEST_CASE("holes in a map over float's whole range are filled without overflow") {
  Image map(3, 3, 1, 3e38F);
  map.at(1, 1) = std::numeric_limits<float>::quiet_NaN();
  CHECK(disparity_from_map(map, DepthKind::kDisparity, 3, 3, "d").data<float>()[4] ==
        doctest::Approx(3e38).epsilon(1e-6));
}

TEST_CASE("a map of another size is resampled at half-pixel centres, one of another shape is refused") {
  Image ramp(8, 4, 1);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 8; ++x) ramp.at(x, y) = static_cast<float>(x);
  const Tensor twice = disparity_from_map(ramp, DepthKind::kDisparity, 16, 8, "d.pfm");
  for (std::size_t x = 1; x < 15; ++x)
    CHECK(twice.data<float>()[x] == doctest::Approx((static_cast<double>(x) + 0.5) / 2 - 0.5));
  CHECK_THROWS_WITH_AS((void)disparity_from_map(ramp, DepthKind::kDisparity, 16, 16, "d.pfm"),
                       doctest::Contains("d.pfm has 8x4 pixels"), Error);
  CHECK_THROWS_WITH_AS((void)disparity_from_map(ramp, DepthKind::kDisparity, 40, 80, "d.pfm"),
                       doctest::Contains("lies on its side"), Error);
  CHECK_NOTHROW((void)disparity_from_map(ramp, DepthKind::kDisparity, 160, 77, "d.pfm"));
  CHECK_THROWS_AS((void)disparity_from_map(ramp, DepthKind::kDisparity, 160, 74, "d.pfm"), Error);
}

TEST_CASE("a map over float's whole range is resampled without overflow") {
  Image map(2, 1, 1);
  map.at(0, 0) = -3e38F;
  map.at(1, 0) = 3e38F;
  const Tensor wide = disparity_from_map(map, DepthKind::kDisparity, 4, 2, "d.pfm");
  CHECK(wide.data<float>()[1] == doctest::Approx(-1.5e38));
  CHECK(wide.data<float>()[2] == doctest::Approx(1.5e38));
}

TEST_CASE("an inverted map is near where it is black") {
  Image map(2, 1, 1);
  map.at(1, 0) = 1;
  const Tensor d = disparity_from_map(map, DepthKind::kInverted, 2, 1, "d.png");
  CHECK(d.data<float>()[0] > d.data<float>()[1]);
}

TEST_CASE("names of depth kinds") {
  CHECK(depth_kind("depth") == DepthKind::kDepth);
  CHECK(depth_kind("inverted") == DepthKind::kInverted);
  CHECK_THROWS_AS((void)depth_kind("deep"), Error);
}
