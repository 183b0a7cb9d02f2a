#include "ops/layering/layering.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "judge.h"
#include "ops/layering/layering_ops.h"

using namespace slide;
using test::Call;
using test::call_of;
using test::random_tensor;
using test::tensor_by;
using test::values;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

Call cone(Tensor x, double rho, std::int64_t radius) {
  return call_of(std::move(x), [&](Value v) { return ops::cone_dilation(v, rho, radius); });
}

/// Float32 numbers in [0, 1), as disparity.
Tensor disparity(const Shape& shape, unsigned seed) {
  std::mt19937 generator(seed);
  return tensor_by(shape, [&](std::int64_t) { return static_cast<double>(generator() >> 8) * 0x1p-24; });
}

}  // namespace

TEST_CASE("a Gaussian sums to 1: a constant stays, and a pulse keeps its weight") {
  for (const double sigma : {0.0, 0.3, 1.0, 2.7}) {
    const ops::GaussianBlurOp op(sigma);
    const std::vector<double> taps = op.taps();
    double sum = taps[0];
    for (std::size_t i = 1; i < taps.size(); ++i) sum += 2 * taps[i];
    CHECK(std::fabs(sum - 1) < 1e-15);
    CHECK(taps.size() == static_cast<std::size_t>(std::ceil(3 * sigma)) + 1);
    const Call flat = call_of(tensor_by({1, 1, 7, 30}, [](std::int64_t) { return 0.625; }),
                              [&](Value x) { return ops::gaussian_blur(x, sigma); });
    for (const double v : values(flat.reference())) CHECK(std::fabs(v - 0.625) < 1e-14);
    const Call pulse =
        call_of(tensor_by({1, 1, 31, 31}, [](std::int64_t i) { return i == 15 * 31 + 15 ? 1.0 : 0.0; }),
                [&](Value x) { return ops::gaussian_blur(x, sigma); });
    double weight = 0;
    for (const double v : values(pulse.reference())) weight += v;
    CHECK(std::fabs(weight - 1) < 1e-14);
    test::judge(flat);
    test::judge(pulse);
  }
}

TEST_CASE("sobel of a plane is its slope everywhere but at the border, where half the step is missing") {
  const Call call =
      call_of(tensor_by({1, 1, 6, 37},
                        [](std::int64_t i) {
                          return 0.5 * static_cast<double>(i % 37) - 0.125 * static_cast<double>(i / 37);
                        }),
              [](Value x) { return ops::sobel(x); });
  const std::vector<double> y = values(call.reference());
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t j = 0; j < 37; ++j) {
      CHECK(y[i * 37 + j] == (j == 0 || j == 36 ? 0.25 : 0.5));
      CHECK(y[6 * 37 + i * 37 + j] == (i == 0 || i == 5 ? -0.0625 : -0.125));
    }
  test::judge(call);
}

TEST_CASE("filter kernels keep their bounds at every width around the vector width") {
  for (const std::int64_t width : {1, 2, 7, 16, 17, 33, 50})
    for (const std::int64_t height : {1, 2, 19}) {
      const Tensor x = random_tensor({2, 1, height, width}, static_cast<unsigned>(width));
      for (const double sigma : {0.0, 1.0, 6.0})
        test::judge(call_of(x, [&](Value v) { return ops::gaussian_blur(v, sigma); }));
      test::judge(call_of(x, [](Value v) { return ops::sobel(v); }));
    }
}

TEST_CASE(
    "cone dilation agrees with the definition pair by pair for every radius from 0 to beyond the image") {
  const Tensor x = disparity({1, 2, 23, 41}, 1);
  for (const double rho : {0.0, 0x1p-6, 0.02, 0.3})
    for (const std::int64_t radius : {0, 1, 2, 3, 5, 7, 10, 11, 20, 21, 22, 23, 39, 40, 41, 1000})
      test::judge(cone(x, rho, radius));
  test::judge(cone(x, 0.01, std::numeric_limits<std::int64_t>::max()));
}

TEST_CASE("cone dilation keeps its bound on images of any size around the vector width, in long lines too") {
  for (const auto& [height, width] :
       {std::pair{1, 1}, {1, 40}, {40, 1}, {2, 3}, {9, 16}, {17, 33}, {33, 65}, {3, 700}})
    for (const std::int64_t radius : {1, 4, 50})
      test::judge(cone(disparity({1, 1, height, width}, static_cast<unsigned>(width)), 0.015625, radius));
}

TEST_CASE("cone dilation of constants, steps, ramps on the cone's own slope, and single pixels") {
  constexpr std::int64_t kW = 37;
  const auto image = [](const std::function<double(double, double)>& f) {
    return tensor_by({1, 1, 29, kW}, [&](std::int64_t i) {
      return static_cast<double>(
          static_cast<float>(f(static_cast<double>(i / kW), static_cast<double>(i % kW))));
    });
  };
  const std::vector<Tensor> images = {
      image([](double, double) { return 0.7; }),
      image([](double, double column) { return column < 18 ? 0.9 : 0.1; }),
      image([](double row, double) { return row < 10 ? 0.1 : 0.9; }),
      image([](double row, double column) {
        return 0.03 * (row + column);
      }),  // ties within rounding everywhere
      image([](double row, double column) { return 1 - 0.03 * (row + column); }),
      image([](double row, double column) { return row == 11 && column == 20 ? 1.0 : 0.0; }),
      image([](double row, double column) { return row == 11 && column == 20 ? -1.0 : 0.0; }),
      image([](double, double column) { return std::fabs(column - 18) * -0.03; }),
  };
  for (const Tensor& x : images)
    for (const std::int64_t radius : {0, 1, 4, 12, 36, 60}) test::judge(cone(x, 0.03, radius));
  const std::vector<double> pulse = values(cone(images[5], 0.25, 3).reference());
  const auto at = [&](std::size_t row, std::size_t column) { return pulse[row * kW + column]; };
  CHECK(at(11, 20) == 1.0);
  CHECK(at(11, 23) == 0.25);
  CHECK(at(8, 20) == 0.25);
  CHECK(at(11, 24) == 0.0);
  CHECK(at(12, 21) == 0.0);  // not on the same scan line
}

TEST_CASE("with a fused multiply-add the result is within 2 roundings where rho is a float32 number") {
  const Call call = cone(disparity({1, 1, 64, 96}, 3), 0x1p-5, 32);
  const std::vector<Shape> shapes = call.input_shapes();
  for (const Kernel* kernel : call.op->kernels())
    CHECK(kernel->error_factor(*call.op, shapes) <= (kernel->isa() == Isa::kBaseline ? 6.001 : 2.001));
  test::judge(call);
}

TEST_CASE("NaN spreads to exactly the pixels whose window contains it") {
  for (const std::int64_t radius : {0, 1, 5, 13, 100}) {
    Tensor x = disparity({1, 1, 21, 39}, 2);
    x.mutable_data<double>()[8 * 39 + 17] = kNaN;
    const Call call = cone(x, 0.05, radius);
    const std::vector<double> y = values(call.reference());
    for (std::int64_t i = 0; i < 21; ++i)
      for (std::int64_t j = 0; j < 39; ++j) {
        const bool sees = (i == 8 && std::abs(j - 17) <= radius) || (j == 17 && std::abs(i - 8) <= radius);
        REQUIRE(std::isnan(y[static_cast<std::size_t>(i * 39 + j)]) == sees);
      }
    test::judge(call);
  }
}

TEST_CASE("attributes that make no sense are refused") {
  Graph g;
  const Value x = g.input("x", {1, 2, 5, 5});
  CHECK(test::refusal([&] { (void)ops::gaussian_blur(x, -1); }).find("sigma is -1") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::gaussian_blur(x, kNaN); }).find("sigma") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::sobel(x); }).find("one channel") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::cone_dilation(x, -0.1, 3); }).find("rho is -0.1") !=
        std::string::npos);
  CHECK(test::refusal([&] { (void)ops::cone_dilation(x, kNaN, 3); }).find("rho") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::cone_dilation(x, 0.1, -1); }).find("radius is -1") !=
        std::string::npos);
}
