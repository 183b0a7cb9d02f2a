#include "ops/resize/resize.h"

#include <cmath>

#include "judge.h"
#include "ops/resize/resize_op.h"

using namespace slide;
using ops::ResizeCoordinates;
using ops::ResizeMode;
using test::Call;
using test::call_of;
using test::random_tensor;

namespace {

ops::ResizeParams to(ResizeMode mode, ResizeCoordinates coordinates, std::int64_t height,
                     std::int64_t width) {
  ops::ResizeParams p;
  p.mode = mode;
  p.coordinates = coordinates;
  p.size = {height, width};
  return p;
}

constexpr ResizeMode kModes[] = {ResizeMode::kNearest, ResizeMode::kLinear, ResizeMode::kCubic};
constexpr ResizeCoordinates kCoordinates[] = {
    ResizeCoordinates::kHalfPixel, ResizeCoordinates::kPytorchHalfPixel, ResizeCoordinates::kAlignCorners,
    ResizeCoordinates::kAsymmetric};

}  // namespace

TEST_CASE("a resize of a plane is the same plane where no sample lies beyond the border") {
  // Of Keys' kernels only a = -1/2 reproduces linear functions.
  constexpr std::int64_t kH = 16;
  constexpr std::int64_t kW = 20;
  const auto plane = [](double row, double column) { return 0.25 + 0.5 * row - 0.125 * column; };
  const Tensor x = test::tensor_by({1, 1, kH, kW}, [&](std::int64_t i) {
    return plane(static_cast<double>(i / kW), static_cast<double>(i % kW));
  });
  for (const ResizeMode mode : {ResizeMode::kLinear, ResizeMode::kCubic})
    for (const ResizeCoordinates coordinates : kCoordinates)
      for (const auto& [height, width] : {std::pair{37, 29}, {32, 40}, {9, 11}, {16, 20}}) {
        ops::ResizeParams p = to(mode, coordinates, height, width);
        p.cubic_a = -0.5;
        const Call call = call_of(x, [&](Value v) { return ops::resize(v, p); });
        const Tensor y = call.reference();
        const auto coordinate = [&](int i, double in, double out) {
          switch (coordinates) {
            case ResizeCoordinates::kAlignCorners:
              return i * (in - 1) / (out - 1);
            case ResizeCoordinates::kAsymmetric:
              return i * in / out;
            default:
              return (i + 0.5) * in / out - 0.5;
          }
        };
        const double margin = mode == ResizeMode::kCubic ? 1 : 0;
        int inside = 0;
        for (int i = 0; i < height; ++i)
          for (int j = 0; j < width; ++j) {
            const double row = coordinate(i, kH, height);
            const double column = coordinate(j, kW, width);
            if (row < margin || row > kH - 1 - margin || column < margin || column > kW - 1 - margin)
              continue;
            ++inside;
            const double value = y.data<double>()[static_cast<std::size_t>(i * width + j)];
            REQUIRE(std::fabs(value - plane(row, column)) < 1e-13);
          }
        CHECK(inside > height * width / 2);
        test::judge(call);
      }
}

TEST_CASE("a resize to the same size changes nothing, and of a constant gives the constant") {
  const Tensor x = random_tensor({2, 3, 7, 9}, 1);
  const Tensor flat = test::tensor_by({1, 1, 5, 6}, [](std::int64_t) { return 0.75; });
  for (const ResizeMode mode : kModes)
    for (const ResizeCoordinates coordinates : kCoordinates) {
      const Call same = call_of(x, [&](Value v) { return ops::resize(v, to(mode, coordinates, 7, 9)); });
      CHECK(max_abs_difference(same.reference(), x) == 0);
      const Call other = call_of(flat, [&](Value v) { return ops::resize(v, to(mode, coordinates, 13, 3)); });
      // Up to 20 roundings of 2^-53 on terms whose magnitudes add up to less than 2.
      for (const double v : test::values(other.reference())) CHECK(std::fabs(v - 0.75) < 40 * 0x1p-53);
    }
}

TEST_CASE("nearest upsampling repeats each pixel") {
  const Call call =
      call_of(random_tensor({1, 2, 3, 5}, 1), [](Value v) { return ops::upsample_nearest(v, 3); });
  const Tensor y = call.reference();
  CHECK(y.shape() == Shape{1, 2, 9, 15});
  for (std::size_t c = 0; c < 2; ++c)
    for (std::size_t i = 0; i < 9; ++i)
      for (std::size_t j = 0; j < 15; ++j)
        REQUIRE(y.data<double>()[(c * 9 + i) * 15 + j] ==
                call.inputs[0].data<double>()[(c * 3 + i / 3) * 5 + j / 3]);
  test::judge(call);
}

TEST_CASE("Keys' cubic with a = -1/2 reproduces a parabola, with -3/4 it does not") {
  const Tensor x = test::tensor_by({1, 1, 1, 12}, [](std::int64_t i) { return static_cast<double>(i * i); });
  for (const double a : {-0.5, -0.75}) {
    ops::ResizeParams p = to(ResizeMode::kCubic, ResizeCoordinates::kHalfPixel, 1, 36);
    p.cubic_a = a;
    const Tensor y = call_of(x, [&](Value v) { return ops::resize(v, p); }).reference();
    double worst = 0;
    for (int j = 6; j < 30; ++j) {
      const double c = (j + 0.5) / 3 - 0.5;
      worst = std::max(worst, std::fabs(y.data<double>()[static_cast<std::size_t>(j)] - c * c));
    }
    if (a == -0.5)
      CHECK(worst < 1e-12);
    else
      CHECK(worst > 1e-3);
  }
}

TEST_CASE("resize kernels keep their bounds up and down at every width around the vector width") {
  for (const ResizeMode mode : kModes)
    for (const ResizeCoordinates coordinates : kCoordinates)
      for (const std::int64_t width : {1, 2, 7, 16, 33, 67}) {
        const Tensor x = random_tensor({1, 2, 5, 19}, static_cast<unsigned>(width));
        test::judge(
            call_of(x, [&](Value v) { return ops::resize(v, to(mode, coordinates, 2 * width, width)); }));
      }
}

TEST_CASE("resize kernels add a residual within their bounds at every width around the vector width") {
  for (const ResizeMode mode : kModes)
    for (const std::int64_t width : {1, 7, 16, 33}) {
      const Tensor x = random_tensor({1, 2, 5, 19}, static_cast<unsigned>(width));
      const Tensor residual = random_tensor({1, 2, 8, width}, 99);
      test::judge({{x, residual}, [&](const std::vector<Value>& v) {
                     const auto op =
                         std::make_shared<ops::ResizeOp>(to(mode, ResizeCoordinates::kHalfPixel, 8, width),
                                                         ops::ResizeFusion{.residual = true});
                     return v[0].graph().add(op, {v[0], v[1]});
                   }});
    }
}

TEST_CASE("nearest rounding follows ONNX's four rules at ties") {
  const Tensor x = test::tensor_of({1, 1, 1, 4}, {0, 1, 2, 3});
  const auto rounded = [&](ops::NearestRounding rounding) {
    ops::ResizeParams p =
        to(ResizeMode::kNearest, ResizeCoordinates::kAsymmetric, 1, 8);  // 0, 0.5, 1, 1.5, ...
    p.nearest = rounding;
    return test::values(call_of(x, [&](Value v) { return ops::resize(v, p); }).reference());
  };
  CHECK(rounded(ops::NearestRounding::kFloor) == std::vector<double>{0, 0, 1, 1, 2, 2, 3, 3});
  CHECK(rounded(ops::NearestRounding::kCeil) == std::vector<double>{0, 1, 1, 2, 2, 3, 3, 3});
  CHECK(rounded(ops::NearestRounding::kRoundPreferFloor) == std::vector<double>{0, 0, 1, 1, 2, 2, 3, 3});
  CHECK(rounded(ops::NearestRounding::kRoundPreferCeil) == std::vector<double>{0, 1, 1, 2, 2, 3, 3, 3});
}

TEST_CASE("sizes and scales that make no sense are refused") {
  Graph g;
  const Value x = g.input("x", {1, 2, 5, 5});
  CHECK(test::refusal([&] { (void)ops::resize_bilinear(x, 0, 5, true); }).find("0x5") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::upsample_nearest(x, 0); }).find("at least 1") != std::string::npos);
  ops::ResizeParams p = to(ResizeMode::kLinear, ResizeCoordinates::kHalfPixel, 5, 5);
  p.scale = {-1.0, 1.0};
  CHECK(test::refusal([&] { (void)ops::resize(x, p); }).find("scale -1") != std::string::npos);
}
