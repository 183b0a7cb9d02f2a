#include "graphs/windows.h"

#include <doctest/doctest.h>

#include <random>

#include "runtime/error.h"

using namespace slide;
using namespace slide::graphs;

namespace {

Tensor mask(std::int64_t h, std::int64_t w) { return Tensor::zeros(DType::kF32, {1, 1, h, w}); }

void set(Tensor& m, std::int64_t x, std::int64_t y) {
  m.mutable_data<float>()[static_cast<std::size_t>(y * m.shape()[3] + x)] = 1;
}

}  // namespace

TEST_CASE("no hole, no window") { CHECK(hole_windows(mask(20, 30), 5, 4).empty()); }

TEST_CASE("a pixel's window is its margin, aligned outwards and cut at the border") {
  Tensor m = mask(100, 100);
  set(m, 50, 41);
  CHECK(hole_windows(m, 10, 4) == std::vector<Window>{{40, 28, 64, 52}});
  CHECK(hole_windows(m, 80, 4) == std::vector<Window>{{0, 0, 100, 100}});
}

TEST_CASE("diagonal neighbours are one region; windows that overlap become one, others stay apart") {
  Tensor m = mask(100, 200);
  set(m, 10, 10);
  set(m, 11, 11);
  set(m, 20, 10);
  set(m, 150, 80);
  CHECK(hole_windows(m, 0, 1) == std::vector<Window>{{10, 10, 12, 12}, {20, 10, 21, 11}, {150, 80, 151, 81}});
  CHECK(hole_windows(m, 6, 1) == std::vector<Window>{{4, 4, 27, 18}, {144, 74, 157, 87}});
}

TEST_CASE("every hole pixel lies in exactly one window, with its margin around it, on random masks") {
  std::mt19937 random(3);
  for (int round = 0; round < 50; ++round) {
    Tensor m = mask(60, 80);
    for (int i = 0; i < 12; ++i) set(m, random() % 80, random() % 60);
    const auto windows = hole_windows(m, 3, 4);
    for (std::int64_t y = 0; y < 60; ++y)
      for (std::int64_t x = 0; x < 80; ++x) {
        if (m.data<float>()[static_cast<std::size_t>(y * 80 + x)] == 0) continue;
        int inside = 0;
        for (const Window& w : windows)
          inside += w.x0 <= std::max<std::int64_t>(0, x - 3) && w.x1 >= std::min<std::int64_t>(80, x + 4) &&
                    w.y0 <= std::max<std::int64_t>(0, y - 3) && w.y1 >= std::min<std::int64_t>(60, y + 4);
        REQUIRE(inside == 1);
      }
    for (const Window& w : windows) REQUIRE((w.x0 % 4 == 0 && w.y0 % 4 == 0));
  }
}

TEST_CASE("what is cut and pasted back is unchanged") {
  Tensor image(DType::kF32, {1, 3, 7, 9});
  for (std::size_t i = 0; i < image.data<float>().size(); ++i)
    image.mutable_data<float>()[i] = static_cast<float>(i);
  const Window w{2, 1, 8, 5};
  const Tensor part = cut(image, w);
  CHECK(part.data<float>()[0] == 11.0F);
  Tensor other = Tensor::zeros(DType::kF32, {1, 3, 7, 9});
  paste(part, w, other);
  CHECK(max_abs_difference(cut(other, w), part) == 0);
  CHECK(other.data<float>()[0] == 0.0F);
  CHECK_THROWS_AS((void)cut(image, {0, 0, 10, 2}), Error);
}
