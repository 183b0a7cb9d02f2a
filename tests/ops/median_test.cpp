#include "ops/edges/median.h"

#include <doctest/doctest.h>

#include <limits>

#include "kernel_bounds.h"
#include "runtime/error.h"

using namespace slide;
using slide::test::Call;

namespace {

Call median_of(const Tensor& x, std::int64_t radius) {
  return {{x}, [&](const std::vector<Value>& v) { return ops::median(v[0], radius); }};
}

}  // namespace

TEST_CASE("the median of a small picture, by hand, with its border replicated") {
  Tensor x(DType::kF64, {1, 1, 3, 3});
  const double values[] = {9, 1, 2, 8, 7, 3, 6, 5, 4};
  std::ranges::copy(values, x.mutable_data<double>().begin());
  // The corner sees 9 four times of nine, 1 and 8 twice, 7: sorted, the fifth is 8.
  const double wanted[] = {8, 3, 2, 7, 5, 3, 6, 5, 4};
  const Tensor y = median_of(x, 1).reference();
  for (std::size_t i = 0; i < 9; ++i) CHECK(y.data<double>()[i] == wanted[i]);
}

TEST_CASE(
    "a median takes away what is thinner than half its window and keeps straight edges where they are") {
  Tensor x = Tensor::zeros(DType::kF64, {1, 1, 30, 40});
  const auto at = [&](std::size_t i, std::size_t j) -> double& {
    return x.mutable_data<double>()[i * 40 + j];
  };
  for (std::size_t i = 0; i < 30; ++i) {
    for (std::size_t j = 20; j < 40; ++j) at(i, j) = 1;
    at(i, 5) = at(i, 6) = 1;
  }
  const Tensor y = median_of(x, 2).reference();
  for (std::size_t k = 0; k < 1200; ++k) CHECK(y.data<double>()[k] == (k % 40 < 20 ? 0 : 1));
}

TEST_CASE("the median's kernel is exact for all radii and sizes, with ties, huge values and NaN") {
  for (const Shape& shape : {Shape{1, 1, 1, 1}, Shape{2, 3, 7, 130}, Shape{1, 1, 131, 65}})
    for (const std::int64_t radius : {0, 1, 2, 8, 40}) {
      if (shape[2] == 131 && radius == 40) continue;  // the definition is slow
      Tensor x = test::random_tensor(shape, 11);
      CHECK(test::check_kernels(median_of(x, radius)) > 0);
      for (double& v : x.mutable_data<double>()) v = std::floor(2 * v);
      x.mutable_data<double>()[0] = std::numeric_limits<double>::quiet_NaN();
      x.mutable_data<double>()[x.data<double>().size() / 2] = -3e38F;
      CHECK(test::check_kernels(median_of(x, radius)) > 0);
    }
}

TEST_CASE("a median's radius out of range is refused") {
  Graph g;
  const Value x = g.input("x", {1, 1, 8, 8});
  CHECK_THROWS_AS((void)ops::median(x, -1), Error);
  CHECK_THROWS_AS((void)ops::median(x, 1025), Error);
}
