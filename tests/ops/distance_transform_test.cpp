#include "ops/layering/distance_transform.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "judge.h"

using namespace slide;
using test::Call;
using test::call_of;
using test::tensor_by;
using test::values;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Call transform(Tensor x) {
  return call_of(std::move(x), [](Value v) { return ops::distance_transform(v); });
}

/// Pixels marked with a probability of one in `rarity`, the others anything up to 0.5.
Tensor marks(const Shape& shape, unsigned seed, unsigned rarity) {
  std::mt19937 generator(seed);
  return tensor_by(shape, [&](std::int64_t) {
    const bool marked = generator() % rarity == 0;
    const double v = static_cast<double>(generator() >> 9) * 0x1p-24;
    return marked ? 0.5 + 0x1p-24 + v : v;
  });
}

/// The definition, word by word.
std::vector<double> brute_force(const Tensor& x) {
  const Shape& s = x.shape();
  const std::int64_t plane = s[2] * s[3];
  std::vector<double> y(static_cast<std::size_t>(x.count()), kInfinity);
  for (std::int64_t p = 0; p < x.count(); ++p)
    for (std::int64_t q = p / plane * plane; q < (p / plane + 1) * plane; ++q) {
      if (!(x.data<double>()[static_cast<std::size_t>(q)] > 0.5)) continue;
      const std::int64_t dy = p % plane / s[3] - q % plane / s[3];
      const std::int64_t dx = p % s[3] - q % s[3];
      double& least = y[static_cast<std::size_t>(p)];
      least = std::min(least, static_cast<double>(dy * dy + dx * dx));
    }
  return y;
}

double exact_factor(const Shape& shape) {
  Graph g;
  const Value y = ops::distance_transform(g.input("x", shape));
  const Op& op = *g.node(y.node()).op;
  const Shape shapes[] = {shape};
  return op.kernels()[0]->error_factor(op, shapes);
}

}  // namespace

TEST_CASE("the distance transform is the brute-force minimum, and the kernel gives the same numbers") {
  const Shape shapes[] = {{1, 1, 1, 1},   {1, 1, 1, 70},  {1, 1, 70, 1},  {1, 1, 2, 3},
                          {2, 3, 17, 23}, {1, 1, 40, 67}, {1, 2, 33, 130}};
  unsigned seed = 1;
  for (const Shape& shape : shapes)
    for (const unsigned rarity : {1U, 2U, 20U, 400U}) {
      const Call call = transform(marks(shape, ++seed, rarity));
      CHECK(exact_factor(shape) == 0);
      CHECK(values(call.reference()) == brute_force(call.inputs[0]));
      test::judge(call);
    }
}

TEST_CASE("the distances to one pixel are those of the definition, and its parabolas tie along a diagonal") {
  const Call one =
      transform(tensor_by({1, 1, 9, 31}, [](std::int64_t i) { return i == 4 * 31 + 20 ? 1.0 : 0.0; }));
  const std::vector<double> y = values(one.reference());
  CHECK(y[4 * 31 + 20] == 0);
  CHECK(y[4 * 31 + 23] == 9);
  CHECK(y[7 * 31 + 24] == 25);
  CHECK(y[0] == 416);
  test::judge(one);
  const Call diagonal =
      transform(tensor_by({1, 1, 32, 32}, [](std::int64_t i) { return i % 32 == i / 32 ? 1.0 : 0.0; }));
  CHECK(values(diagonal.reference()) == brute_force(diagonal.inputs[0]));
  test::judge(diagonal);
}

TEST_CASE("a plane without a marked pixel is infinitely far, and does not disturb the next") {
  Tensor x = tensor_by({1, 2, 5, 6}, [](std::int64_t i) { return i < 30 ? 0.5 : i == 41 ? 0.75 : 0.0; });
  x.mutable_data<double>()[3] = std::numeric_limits<double>::quiet_NaN();
  const Call call = transform(x);
  const std::vector<double> y = values(call.reference());
  for (std::size_t i = 0; i < 30; ++i) CHECK(y[i] == kInfinity);
  CHECK(y[41] == 0);
  CHECK(y == brute_force(x));
  test::judge(call);
}

TEST_CASE("planes with a diagonal beyond 4096 pixels round the exact number once") {
  CHECK(exact_factor({1, 1, 1, 4097}) == 0);
  CHECK(exact_factor({1, 1, 1, 4098}) == 1);
  const Call call = transform(tensor_by({1, 1, 2, 5000}, [](std::int64_t i) { return i == 0 ? 1.0 : 0.0; }));
  CHECK(values(call.reference()).back() == 4999.0 * 4999 + 1);
  test::judge(call);
}

TEST_CASE("what is no picture, and one too large, is refused") {
  Graph g;
  CHECK(test::refusal([&] { (void)ops::distance_transform(g.input("x", {5, 5})); }) != "");
  CHECK(test::refusal([&] {
          (void)ops::distance_transform(g.input("y", {1, 1, 1, (1 << 24) + 1}));
        }).find("too large") != std::string::npos);
}
