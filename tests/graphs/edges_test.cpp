#include "graphs/edges.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

#include "runtime/fast_executor.h"
#include "runtime/reference_executor.h"

using namespace slide;
using namespace slide::graphs;

namespace {

constexpr std::int64_t kHeight = 60;
constexpr std::int64_t kWidth = 480;  // windows of 3, 7 and 17 pixels

/// A 1×channels×kHeight×kWidth tensor of f(x).
template <typename F>
Tensor columns(std::int64_t channels, const F& f) {
  Tensor t(DType::kF32, {1, channels, kHeight, kWidth});
  const auto values = t.mutable_data<float>();
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = static_cast<float>(f(static_cast<double>(i % kWidth)));
  return t;
}

Tensor sharpened(const Tensor& disparity, const Tensor& image) {
  Graph g;
  g.output("D", sharpen_edges(g.input("d", disparity.shape()), g.input("image", image.shape())));
  FastExecutor run(g, WeightMap());
  run.run({{"d", disparity}, {"image", image}});
  return run.tensor("D").clone();
}

/// From 0.2 to 0.8 over `width` pixels around `middle`, steepest there.
double ramp(double x, double middle, double width) {
  const double t = std::clamp((x - middle) / width + 0.5, 0.0, 1.0);
  return 0.2 + 0.6 * t * t * (3 - 2 * t);
}

/// Where a row first is over one half.
std::int64_t crossing(const Tensor& d) {
  const float* row = d.data<float>().data() + kHeight / 2 * kWidth;
  return std::find_if(row, row + kWidth, [](float v) { return v > 0.5F; }) - row;
}

const auto kGrey = [](double /*x*/) { return 0.5; };

}  // namespace

TEST_CASE("a ramp of a few pixels becomes a jump, at its middle where the photo shows nothing") {
  const Tensor d = sharpened(columns(1, [](double x) { return ramp(x, 239.5, 8); }), columns(3, kGrey));
  for (std::int64_t i = 0; i < kHeight; ++i)
    for (std::int64_t j = 0; j < kWidth; ++j)
      REQUIRE(d.data<float>()[static_cast<std::size_t>(i * kWidth + j)] ==
              doctest::Approx(j < 240 ? 0.2 : 0.8).epsilon(1e-6));
}

TEST_CASE("the jump moves onto the photo's edge from up to four pixels away") {
  for (const double edge : {236.0, 238.0, 242.0, 244.0}) {
    CAPTURE(edge);
    const Tensor d = sharpened(columns(1, [](double x) { return ramp(x, 239.5, 8); }),
                               columns(3, [&](double x) { return x < edge ? 0.2 : 0.7; }));
    CHECK(crossing(d) == static_cast<std::int64_t>(edge));
  }
}

TEST_CASE("a thin line between both sides goes with the near one, not into a busy background") {
  const Tensor disparity = columns(1, [](double x) { return ramp(x, 239.5, 8); });
  const auto line = [](double x) { return x >= 238 && x < 240 ? 0.1 : 0.8; };
  CHECK(crossing(sharpened(disparity, columns(3, line))) == 238);
  const auto busy = [](double x) { return x >= 240 ? 0.5 : std::fmod(x, 4) < 2 ? 0.1 : 0.9; };
  CHECK(crossing(sharpened(disparity, columns(3, busy))) == 240);
}

TEST_CASE("a smooth slope stays what it is, whatever the photo shows") {
  // 0.03 over the widest window of 17 pixels would count as a slope still; this is half of that.
  const Tensor slope = columns(1, [](double x) { return 0.1 + 0.015 * x / 16; });
  const Tensor d = sharpened(slope, columns(3, [](double x) { return x < 200 ? 0.1 : 0.9; }));
  for (std::int64_t j = 8; j < kWidth - 8; ++j) {
    const auto at = static_cast<std::size_t>(kHeight / 2 * kWidth + j);
    REQUIRE(d.data<float>()[at] == slope.data<float>()[at]);
  }
}

TEST_CASE("a steep plane stays one, and a jump on it is told from it") {
  // 0.05 over the widest window of 17 pixels, which without its slope would count as a jump. At 240 one of
  // 0.2.
  const auto plane = [](double x) { return 0.05 / 16 * std::clamp(x - 120, 0.0, 240.0); };
  const auto texture = columns(3, [](double x) { return 0.5 + 0.5 * std::sin(x * x); });
  const Tensor d = sharpened(columns(1, plane), texture);
  const Tensor stepped = sharpened(columns(1, [&](double x) { return plane(x) + ramp(x, 239.5, 8) / 3; }),
                                   columns(3, [](double x) { return x < 240 ? 0.2 : 0.7; }));
  for (std::int64_t j = 145; j < 335; ++j) {
    CAPTURE(j);
    const auto at = static_cast<std::size_t>(kHeight / 2 * kWidth + j);
    REQUIRE(d.data<float>()[at] == doctest::Approx(plane(static_cast<double>(j))).epsilon(1e-6));
  }
  const float* row = stepped.data<float>().data() + kHeight / 2 * kWidth;
  CHECK(row[240] - row[239] > 0.18F);
}

TEST_CASE("no value leaves the range of its surroundings") {
  const Tensor d = sharpened(columns(1, [](double x) { return ramp(x, 100, 30) - ramp(x, 300, 3) + 0.2; }),
                             columns(3, [](double x) { return 0.5 + 0.5 * std::sin(x * x); }));
  for (const float v : d.data<float>()) REQUIRE((v >= 0.2F - 1e-6F && v <= 0.8F + 1e-6F));
  // Far from both jumps nothing changes.
  CHECK(d.data<float>()[kHeight / 2 * kWidth + 200] == doctest::Approx(0.8).epsilon(1e-6));
  CHECK(d.data<float>()[kHeight / 2 * kWidth + 400] == doctest::Approx(0.2).epsilon(1e-6));
}

TEST_CASE("a jump takes as many pixels as its range over its steepest step") {
  // A step, a straight ramp over 4 steps, and a smoothstep over 8, whose slope in the middle is 1.5 times the mean.
  const Jumps step = find_jumps(columns(1, [](double x) { return x < 240 ? 5 : 9; }));
  CHECK(step.pixels == doctest::Approx(1).epsilon(1e-6));
  CHECK(step.count == kHeight);
  const Jumps line = find_jumps(columns(1, [](double x) { return std::clamp((x - 240) / 4, 0.0, 1.0); }));
  CHECK(line.pixels == doctest::Approx(4).epsilon(1e-6));
  CHECK(line.count == kHeight);
  const Jumps smooth = find_jumps(columns(1, [](double x) { return ramp(x, 239.5, 8); }));
  // Of its range the window holds that between t = 1/16 and 15/16; the steepest step is from 7/16 to 9/16.
  const auto part = [](double t) { return t * t * (3 - 2 * t); };
  CHECK(
      smooth.pixels ==
      doctest::Approx((part(15.0 / 16) - part(1.0 / 16)) / (part(9.0 / 16) - part(7.0 / 16))).epsilon(1e-5));
  // Two steps to one ramp in each row: the median is the steps'.
  const Jumps mixed = find_jumps(columns(1, [](double x) {
    return (x < 100 ? 0 : 0.3) + (x < 200 ? 0 : 0.3) + 0.4 * std::clamp((x - 300) / 5, 0.0, 1.0);
  }));
  CHECK(mixed.pixels == doctest::Approx(1).epsilon(1e-6));
  CHECK(mixed.count == 3 * kHeight);
}

TEST_CASE("soft edges take more than three pixels and more than a part of the photo's size") {
  const auto over = [](double pixels) {
    return [pixels](double x) { return std::clamp((x - 240) / pixels, 0.0, 1.0); };
  };
  CHECK(!has_soft_edges(columns(1, over(1))));
  CHECK(!has_soft_edges(columns(1, over(2.9))));
  CHECK(has_soft_edges(columns(1, over(3.5))));
  CHECK(has_soft_edges(columns(1, over(5))));
  // In a photo of 1600 pixels 4 are allowed.
  const auto wide = [&](double pixels) {
    Tensor t(DType::kF32, {1, 1, kHeight, 1600});
    const auto values = t.mutable_data<float>();
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] = static_cast<float>(over(pixels)(static_cast<double>(i % 1600)));
    return t;
  };
  CHECK(!has_soft_edges(wide(3)));
  CHECK(has_soft_edges(wide(5)));
}

TEST_CASE("a slope, and a handful of jumps, are no soft edges") {
  CHECK(find_jumps(columns(1, [](double x) { return x; })).count == 0);
  CHECK(find_jumps(columns(1, kGrey)).count == 0);
  Tensor few(DType::kF32, {1, 1, 40, kWidth});  // a jump a row
  const auto values = few.mutable_data<float>();
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = static_cast<float>(std::clamp((static_cast<double>(i % kWidth) - 240) / 4, 0.0, 1.0));
  CHECK(find_jumps(few).count == 40);
  CHECK(!has_soft_edges(few));
}

TEST_CASE("float32 and float64 sharpen alike") {
  const Tensor disparity = columns(1, [](double x) { return ramp(x, 101.3, 9); });
  const Tensor image = columns(3, [](double x) { return 0.5 + 0.3 * std::tanh(x - 103); });
  Graph g;
  g.output("D", sharpen_edges(g.input("d", disparity.shape()), g.input("image", image.shape())));
  ReferenceExecutor run(g, WeightMap());
  run.run({{"d", disparity}, {"image", image}});
  CHECK(max_abs_difference(run.tensor("D"), sharpened(disparity, image)) <= 1e-6);
}
