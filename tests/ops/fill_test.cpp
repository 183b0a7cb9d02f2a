#include "ops/fill/fill.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "kernel_bounds.h"
#include "runtime/error.h"
#include "runtime/safetensors.h"

using namespace slide;
using slide::test::Call;

namespace {

Call fill_call(const Tensor& x, const Tensor& weight, int sweeps) {
  return {{x, weight}, [&](const std::vector<Value>& v) { return ops::push_pull_fill(v[0], v[1], sweeps); }};
}

struct Case {
  const char* name;
  int sweeps;
};
constexpr Case kCases[] = {{"odd", 4}, {"row", 2}, {"column", 3}, {"even", 0}, {"empty", 1}, {"pixel", 4}};

/// Known on the left third, unknown (and absurd) elsewhere.
std::pair<Tensor, Tensor> left_third(std::int64_t h, std::int64_t w, double known_value) {
  Tensor x(DType::kF64, {1, 1, h, w});
  Tensor weight(DType::kF64, {1, 1, h, w});
  for (std::int64_t i = 0; i < h * w; ++i) {
    const bool known = i % w < w / 3;
    x.mutable_data<double>()[static_cast<std::size_t>(i)] = known ? known_value : 1e6;
    weight.mutable_data<double>()[static_cast<std::size_t>(i)] = known ? 1 : 0;
  }
  return {x, weight};
}

}  // namespace

TEST_CASE("the fill's definition agrees with PyTorch in float64, and its kernel with the definition") {
  const SafetensorsFile golden = SafetensorsFile::open(SLIDE_TEST_DATA "/ops/fill.safetensors");
  for (const Case& c : kCases) {
    CAPTURE(c.name);
    const auto tensor = [&](const char* what) { return golden.tensor(std::string(c.name) + "." + what); };
    const Call call = fill_call(tensor("x"), tensor("weight"), c.sweeps);
    CHECK(max_abs_difference(call.reference(), tensor("y")) <= 1e-13);
    CHECK(test::check_kernels(call) > 0);
  }
}

TEST_CASE("a constant known region fills everything with its value, whatever lies in the hole") {
  const auto [x, weight] = left_third(33, 50, 0.75);
  const Call call = fill_call(x, weight, 4);
  const Tensor y = call.reference();
  for (const double v : y.data<double>()) CHECK(v == doctest::Approx(0.75).epsilon(1e-14));
}

TEST_CASE("known pixels are kept and the rest stays between their extremes") {
  Tensor x = test::random_tensor({1, 2, 37, 29}, 5);
  Tensor weight = Tensor::zeros(DType::kF64, {1, 1, 37, 29});
  for (std::size_t i = 0; i < 37 * 29; i += 11) weight.mutable_data<double>()[i] = 1;
  const Tensor y = fill_call(x, weight, 4).reference();
  for (std::size_t c = 0; c < 2; ++c) {
    double low = 1e9;
    double high = -1e9;
    for (std::size_t i = 0; i < 37 * 29; i += 11) {
      const double known = x.data<double>()[c * 37 * 29 + i];
      CHECK(y.data<double>()[c * 37 * 29 + i] == known);
      low = std::min(low, known);
      high = std::max(high, known);
    }
    for (std::size_t i = 0; i < 37 * 29; ++i) {
      CHECK(y.data<double>()[c * 37 * 29 + i] >= low - 1e-12);
      CHECK(y.data<double>()[c * 37 * 29 + i] <= high + 1e-12);
    }
  }
}

TEST_CASE("the fill is the same at any thread count and stays in its bound on a large picture") {
  Tensor x = test::random_tensor({1, 4, 120, 161}, 6);
  Tensor weight = Tensor::zeros(DType::kF64, {1, 1, 120, 161});
  for (std::size_t i = 0; i < 120 * 161; ++i)
    weight.mutable_data<double>()[i] = i % 161 < 40 ? 1 : i % 7 == 0 ? 1e-6 : 0;
  CHECK(test::check_kernels(fill_call(x, weight, 4)) > 0);
}

TEST_CASE("a weight of another size is refused") {
  Graph g;
  const Value x = g.input("x", {1, 3, 8, 8});
  const Value w = g.input("w", {1, 3, 8, 8});
  CHECK_THROWS_AS((void)ops::push_pull_fill(x, w, 4), Error);
}
