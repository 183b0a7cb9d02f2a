#include "ops/matting/foreground.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

#include "kernel_bounds.h"
#include "runtime/error.h"

using namespace slide;
using slide::test::Call;

namespace {

Call colours_of(const Tensor& image, const Tensor& alpha) {
  return {{image, alpha}, [](const std::vector<Value>& v) { return ops::foreground_colours(v[0], v[1]); }};
}

/// Numbers in [0, 1], many of them 0 and 1, as mattes have.
Tensor clipped_noise(const Shape& shape, unsigned seed) {
  Tensor t = test::random_tensor(shape, seed, 0.6);
  for (double& v : t.mutable_data<double>())
    v = static_cast<double>(static_cast<float>(std::clamp(v + 0.5, 0.0, 1.0)));
  return t;
}

}  // namespace

TEST_CASE("the colours of a soft edge between two plain ones are found, in front and behind") {
  // I = alpha·F + (1 - alpha)·B with constant F and B solves every level's equations.
  constexpr std::int64_t kH = 40, kW = 64, kPixels = kH * kW;
  constexpr double kFront[] = {0.75, 0.125, 0.5}, kBehind[] = {0.25, 0.875, 0.5};
  Tensor image(DType::kF64, {1, 3, kH, kW}), alpha(DType::kF64, {1, 1, kH, kW});
  for (std::int64_t i = 0; i < kPixels; ++i) {
    const double a = std::clamp((static_cast<double>(i % kW) - 20) / 16, 0.0, 1.0);
    alpha.mutable_data<double>()[static_cast<std::size_t>(i)] = a;
    for (std::size_t c = 0; c < 3; ++c)
      image.mutable_data<double>()[c * kPixels + static_cast<std::size_t>(i)] =
          a * kFront[c] + (1 - a) * kBehind[c];
  }
  const Tensor y = colours_of(image, alpha).reference();
  REQUIRE(y.shape() == Shape{1, 6, kH, kW});
  // Alpha from 0.9 to 1 and 0 to 0.1 counts in the first guess: it is off by up to 0.1 of the difference
  // times those pixels' part, and each level takes that away where a pixel shows the colour.
  for (std::size_t i = 0; i < kPixels; ++i)
    for (std::size_t c = 0; c < 3; ++c) {
      const double a = alpha.data<double>()[i];
      const double front = y.data<double>()[c * kPixels + i],
                   behind = y.data<double>()[(3 + c) * kPixels + i];
      CHECK(std::fabs(a * front + (1 - a) * behind - image.data<double>()[c * kPixels + i]) < 1e-3);
      if (a > 0) CHECK(std::fabs(front - kFront[c]) < 0.01);
      if (a < 1) CHECK(std::fabs(behind - kBehind[c]) < 0.01);
    }
}

TEST_CASE("where alpha is 1 the colour in front is the photo's, where it is 0 the one behind is") {
  // Among equal alphas d = 4e-5, and d / (1 + d) of what a step misses stays.
  const Tensor image = clipped_noise({1, 2, 30, 41}, 4);
  for (const double a : {0.0, 1.0}) {
    Tensor alpha(DType::kF64, {1, 1, 30, 41});
    std::ranges::fill(alpha.mutable_data<double>(), a);
    const Tensor y = colours_of(image, alpha).reference();
    const std::size_t shown = a == 1 ? 0 : 2 * 30 * 41;
    for (std::size_t i = 0; i < 2 * 30 * 41; ++i)
      CHECK(std::fabs(y.data<double>()[shown + i] - image.data<double>()[i]) <= 4.1e-5);
  }
}

TEST_CASE("colours in front and behind keep their bound at every level and any thread count") {
  for (const Shape& shape : {Shape{1, 3, 70, 95}, Shape{2, 1, 1, 40}, Shape{1, 2, 33, 1}, Shape{1, 3, 1, 1},
                             Shape{1, 3, 2, 17}, Shape{2, 3, 32, 33}})
    CHECK(test::check_kernels(colours_of(clipped_noise(shape, 5), clipped_noise(shape.with(1, 1), 6))) ==
          test::whole_levels());
}

TEST_CASE("a matte of another size than its picture is refused") {
  Graph g;
  const Value image = g.input("I", {1, 3, 8, 8});
  CHECK_THROWS_AS((void)ops::foreground_colours(image, g.input("a", {1, 1, 8, 9})), Error);
  CHECK_THROWS_AS((void)ops::foreground_colours(image, g.input("b", {1, 3, 8, 8})), Error);
}
