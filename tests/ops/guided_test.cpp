#include "ops/guided/guided.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "kernel_bounds.h"
#include "runtime/error.h"
#include "runtime/fast_executor.h"
#include "runtime/safetensors.h"

using namespace slide;
using slide::test::Call;

namespace {

Call coefficients(const Tensor& guide, const Tensor& x, std::int64_t radius, double eps) {
  return {{guide, x},
          [&](const std::vector<Value>& v) { return ops::guided_coefficients(v[0], v[1], radius, eps); }};
}

struct Case {
  const char* name;
  std::int64_t radius;
  double eps;
};
constexpr Case kCases[] = {
    {"colour", 4, 1e-3}, {"grey", 2, 1e-2}, {"row", 3, 1e-1}, {"wide", 9, 1}, {"pixel", 1, 1e-2}};

/// What run() gives as float32, by the fast executor.
Tensor upsampled(const Tensor& x, const Tensor& small, const Tensor& guide, std::int64_t radius, double eps) {
  Graph g;
  g.output("y", ops::guided_upsample(g.input("x", x.shape()), g.input("small", small.shape()),
                                     g.input("guide", guide.shape()), radius, eps));
  FastExecutor run(g, WeightMap("no weights"));
  run.run({{"x", x.to(DType::kF32)}, {"small", small.to(DType::kF32)}, {"guide", guide.to(DType::kF32)}});
  return run.tensor("y").clone();
}

/// 1×1×h×w: `right` from column w·share on, `left` before.
Tensor step(std::int64_t h, std::int64_t w, std::int64_t column, double left, double right) {
  Tensor t(DType::kF64, {1, 1, h, w});
  for (std::int64_t i = 0; i < h * w; ++i)
    t.mutable_data<double>()[static_cast<std::size_t>(i)] = i % w < column ? left : right;
  return t;
}

}  // namespace

TEST_CASE("the guided filter's definition agrees with numpy in float64, and its kernel with the definition") {
  const SafetensorsFile golden = SafetensorsFile::open(SLIDE_TEST_DATA "/ops/guided.safetensors");
  for (const Case& c : kCases) {
    CAPTURE(c.name);
    const auto tensor = [&](const char* what) { return golden.tensor(std::string(c.name) + "." + what); };
    const Call call = coefficients(tensor("guide"), tensor("x"), c.radius, c.eps);
    CHECK(max_abs_difference(call.reference(), tensor("y")) <= 1e-11);
    CHECK(test::check_kernels(call) > 0);
  }
}

TEST_CASE("one window over the whole picture is a ridge regression on the guide") {
  // x = 3·g - 1 with the variance v of g: a = 3·v/(v + eps), b = mean(x) - a·mean(g).
  const Tensor guide = test::random_tensor({1, 1, 5, 7}, 3);
  Tensor x(DType::kF64, guide.shape());
  double mean = 0;
  double square = 0;
  for (std::size_t i = 0; i < 35; ++i) {
    const double g = guide.data<double>()[i];
    x.mutable_data<double>()[i] = 3 * g - 1;
    mean += g / 35;
    square += g * g / 35;
  }
  const double variance = square - mean * mean;
  const Tensor y = coefficients(guide, x, 1000, 0.25).reference();
  const double a = 3 * variance / (variance + 0.25);
  for (std::size_t i = 0; i < 35; ++i) {
    CHECK(y.data<double>()[i] == doctest::Approx(a).epsilon(1e-13));
    CHECK(y.data<double>()[35 + i] == doctest::Approx(3 * mean - 1 - a * mean).epsilon(1e-13));
  }
}

TEST_CASE("a constant stays one, whatever the guide shows") {
  const Tensor x = step(9, 12, 0, 0, 0.625);
  const Tensor y = coefficients(test::random_tensor({1, 3, 9, 12}, 4), x, 2, 1e-4).reference();
  for (std::size_t i = 0; i < y.data<double>().size(); ++i)
    CHECK(std::fabs(y.data<double>()[i] - (i < 3 * 9 * 12 ? 0 : 0.625)) <= 1e-15);
}

TEST_CASE("enlarged four times, a soft edge becomes as sharp as the guide's, where the guide has it") {
  // At the small size the edge between columns 7 and 8 is spread over four columns.
  const Tensor small = step(16, 16, 8, 0.2, 0.8);
  Tensor x = step(16, 16, 8, 0, 1);
  const double soft[] = {0.2, 0.4, 0.6, 0.8};
  for (std::size_t row = 0; row < 16; ++row)
    for (std::size_t k = 0; k < 4; ++k) x.mutable_data<double>()[row * 16 + 6 + k] = soft[k];
  const Tensor y = upsampled(x, small, step(64, 64, 32, 0.2, 0.8), 4, 1e-6);
  const float* row = y.data<float>().data() + 32 * 64;
  CHECK(row[32] - row[31] > 0.5F);  // the bilinear one is nowhere steeper than 0.05
  for (std::size_t j = 1; j < 64; ++j)
    if (j != 32) CHECK(std::fabs(row[j] - row[j - 1]) < 0.1F);
}

TEST_CASE("upsampling agrees with numpy to float32") {
  const SafetensorsFile golden = SafetensorsFile::open(SLIDE_TEST_DATA "/ops/guided.safetensors");
  const auto tensor = [&](const char* what) { return golden.tensor(std::string("upsampled.") + what); };
  const Tensor y = upsampled(tensor("x"), tensor("small"), tensor("guide"), 2, 1e-2);
  CHECK(max_abs_difference(y, tensor("y")) <= 1e-6);
}

TEST_CASE("kernels stay in their bound on many rows, several pictures and ill-conditioned guides") {
  const Tensor x = test::random_tensor({2, 1, 70, 45}, 5);
  CHECK(test::check_kernels(coefficients(test::random_tensor({2, 3, 70, 45}, 6), x, 4, 1e-3)) > 0);
  Tensor flat = test::random_tensor({2, 3, 70, 45}, 7, 1e-3);
  for (double& v : flat.mutable_data<double>()) v = static_cast<double>(static_cast<float>(v + 100));
  CHECK(test::check_kernels(coefficients(flat, x, 6, 1e-4)) > 0);
}

TEST_CASE("what does not fit the guide is refused") {
  Graph g;
  const Value guide = g.input("guide", {1, 3, 8, 8});
  const Value x = g.input("x", {1, 1, 8, 8});
  CHECK_THROWS_AS((void)ops::guided_coefficients(guide, g.input("y", {1, 1, 8, 9}), 2, 0.1), Error);
  CHECK_THROWS_AS((void)ops::guided_coefficients(g.input("z", {1, 9, 8, 8}), x, 2, 0.1), Error);
  CHECK_THROWS_AS((void)ops::guided_coefficients(guide, x, -1, 0.1), Error);
  CHECK_THROWS_AS((void)ops::guided_coefficients(guide, x, 2, 0), Error);
}
