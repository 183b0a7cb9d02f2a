#include "render/stereo.h"

#include <doctest/doctest.h>

#include <cmath>

#include "runtime/error.h"

namespace {

slide::Image constant(float r, float g, float b) {
  slide::Image image(3, 2, 3);
  for (std::size_t i = 0; i < image.pixels(); ++i) {
    image.data[3 * i] = r;
    image.data[3 * i + 1] = g;
    image.data[3 * i + 2] = b;
  }
  return image;
}

}  // namespace

TEST_CASE("Side by side, the left view is on the left and pixels are untouched") {
  slide::Image left(3, 2, 3);
  slide::Image right(3, 2, 3);
  for (std::size_t i = 0; i < left.data.size(); ++i) {
    left.data[i] = static_cast<float>(i);
    right.data[i] = 100 + static_cast<float>(i);
  }
  const slide::Image both = slide::side_by_side(left, right);
  REQUIRE(both.width == 6);
  REQUIRE(both.height == 2);
  for (int y = 0; y < 2; ++y) {
    for (int x = 0; x < 3; ++x) {
      for (int c = 0; c < 3; ++c) {
        CHECK(both.at(x, y, c) == left.at(x, y, c));
        CHECK(both.at(x + 3, y, c) == right.at(x, y, c));
      }
    }
  }
}

TEST_CASE("Each kind of stereo picture has its views where players and eyes expect them") {
  slide::Image left(5, 3, 3);
  for (std::size_t i = 0; i < left.data.size(); ++i) left.data[i] = static_cast<float>(i);
  slide::Image right = left;
  for (float& v : right.data) v += 100;
  const auto made = [&](const char* name) {
    return slide::stereo_picture(slide::stereo_kind(name), left, right);
  };
  CHECK(made("sbs").data == slide::side_by_side(left, right).data);
  CHECK(made("anaglyph").data == slide::anaglyph(left, right).data);
  CHECK(made("cross").at(1, 2, 1) == right.at(1, 2, 1));
  CHECK(made("cross").at(5 + 1, 2, 1) == left.at(1, 2, 1));
  const slide::Image tb = made("tb");
  REQUIRE((tb.width == 5 && tb.height == 6));
  CHECK(tb.at(4, 2, 2) == left.at(4, 2, 2));
  CHECK(tb.at(4, 3 + 2, 2) == right.at(4, 2, 2));
  const slide::Image half_sbs = made("half-sbs");
  REQUIRE((half_sbs.width == 6 && half_sbs.height == 3));
  CHECK(half_sbs.at(1, 1, 0) == (left.at(2, 1, 0) + left.at(3, 1, 0)) / 2);
  CHECK(half_sbs.at(2, 1, 0) == left.at(4, 1, 0));
  CHECK(half_sbs.at(3, 1, 0) == (right.at(0, 1, 0) + right.at(1, 1, 0)) / 2);
  const slide::Image half_tb = made("half-tb");
  REQUIRE((half_tb.width == 5 && half_tb.height == 4));
  CHECK(half_tb.at(3, 0, 1) == (left.at(3, 0, 1) + left.at(3, 1, 1)) / 2);
  CHECK(half_tb.at(3, 1, 1) == left.at(3, 2, 1));
  CHECK(half_tb.at(3, 2, 1) == (right.at(3, 0, 1) + right.at(3, 1, 1)) / 2);
  CHECK_THROWS_AS((void)slide::stereo_kind("3d"), slide::Error);
}

TEST_CASE("The anaglyph of two equal greys is nearly that grey, and each eye's filter passes its own view") {
  // Dubois' matrices sum to one to within 2 % for equal greys.
  const slide::Image grey = slide::anaglyph(constant(0.5F, 0.5F, 0.5F), constant(0.5F, 0.5F, 0.5F));
  for (const float v : grey.data) CHECK(std::abs(v - 0.5F) < 0.01F);
  const slide::Image left_only = slide::anaglyph(constant(1, 1, 1), constant(0, 0, 0));
  CHECK(left_only.at(0, 0, 0) > 0.99F);
  CHECK(left_only.at(0, 0, 1) == 0.0F);
  CHECK(left_only.at(0, 0, 2) == 0.0F);
  const slide::Image right_only = slide::anaglyph(constant(0, 0, 0), constant(1, 1, 1));
  CHECK(right_only.at(0, 0, 0) == 0.0F);
  CHECK(right_only.at(0, 0, 1) > 0.99F);
  CHECK(right_only.at(0, 0, 2) > 0.99F);
}

TEST_CASE("The anaglyph works in linear light") {
  // A right view of pure blue 0.5: linear 0.21404; blue weight 1.2264; green -0.01845 clips to 0.
  const slide::Image image = slide::anaglyph(constant(0, 0, 0), constant(0, 0, 0.5F));
  const double linear = 1.2264 * std::pow((0.5 + 0.055) / 1.055, 2.4);
  CHECK(image.at(1, 1, 2) == doctest::Approx(1.055 * std::pow(linear, 1 / 2.4) - 0.055).epsilon(1e-6));
  CHECK(image.at(1, 1, 1) == 0.0F);
}

TEST_CASE("Views that do not match are refused") {
  CHECK_THROWS_AS(static_cast<void>(slide::side_by_side(slide::Image(3, 2, 3), slide::Image(4, 2, 3))),
                  slide::Error);
  CHECK_THROWS_AS(static_cast<void>(slide::anaglyph(slide::Image(3, 2, 1), slide::Image(3, 2, 1))),
                  slide::Error);
}
