#include "ops/pointwise/pointwise.h"

#include <cmath>
#include <limits>

#include "judge.h"
#include "ops/pointwise/unary_op.h"

using namespace slide;
using test::Call;
using test::call_of;
using test::random_tensor;

namespace {

using Unary = std::function<Value(Value)>;
using Binary = Value (*)(Value, Value);

const std::vector<Unary>& unary_functions() {
  static const std::vector<Unary> all = {
      [](Value x) { return ops::relu(x); },
      [](Value x) { return ops::relu6(x); },
      [](Value x) { return ops::leaky_relu(x, 0.2); },
      [](Value x) { return ops::elu(x); },
      [](Value x) { return ops::elu(x, 0.7); },
      [](Value x) { return ops::sigmoid(x); },
      [](Value x) { return ops::tanh(x); },
      [](Value x) { return ops::exp(x); },
      [](Value x) { return ops::sqrt(x); },
      [](Value x) { return ops::abs(x); },
      [](Value x) { return ops::clip(x, -0.3, 1.1); },
      [](Value x) { return ops::affine(x, 1.7, -0.3); },
      [](Value x) { return ops::greater(x, 0.1); },
  };
  return all;
}

constexpr Binary kBinary[] = {ops::add, ops::sub, ops::mul, ops::div, ops::minimum, ops::maximum};

Call binary_call(Tensor a, Tensor b, Binary f) {
  return {{std::move(a), std::move(b)}, [&](const std::vector<Value>& v) { return f(v[0], v[1]); }};
}

}  // namespace

TEST_CASE("pointwise kernels keep their bounds at every length around the vector width") {
  for (const Unary& f : unary_functions())
    for (const std::int64_t n : {1, 3, 4, 5, 15, 16, 17, 31, 33, 67}) {
      const Tensor x = random_tensor({n}, static_cast<unsigned>(n), 4);
      test::judge(call_of(x, f));
    }
}

TEST_CASE(
    "pointwise kernels give what the definition gives for NaN, infinities, zeros and the largest numbers") {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  constexpr double kMax = std::numeric_limits<float>::max();
  const Tensor x =
      test::tensor_of({11}, {std::nan(""), kInf, -kInf, 0.0, -0.0, kMax, -kMax, 88.0, -88.0, 6.0, 1e-30});
  for (const Unary& f : unary_functions()) test::judge(call_of(x, f));
  const Tensor y =
      test::tensor_of({11}, {1.0, std::nan(""), -kInf, 0.0, 2.0, kMax, kMax, -1.0, 0.5, 3.0, 1e30});
  for (const Binary f : kBinary) {
    test::judge(binary_call(x, y, f));
    test::judge(binary_call(y, x, f));
  }
}

TEST_CASE("a threshold between two float32 numbers divides them as in float64") {
  const float below = std::nextafter(0.1F, 0.0F);  // 0.1F itself is above 0.1
  const Tensor x = test::tensor_of({3}, {static_cast<double>(below), static_cast<double>(0.1F), 0.2});
  const Call call = call_of(x, [](Value v) { return ops::greater(v, 0.1); });
  CHECK(test::values(call.reference()) == std::vector<double>{0, 1, 1});
  test::judge(call);
}

TEST_CASE("binary operators broadcast as in NumPy, checked element by element on many pairs of shapes") {
  std::mt19937 generator(5);
  for (int trial = 0; trial < 60; ++trial) {
    // Two shapes that agree with one full shape, each with some axes of extent 1 and leading axes left out.
    const std::size_t rank = generator() % 6;
    std::vector<std::int64_t> full(rank);
    for (std::int64_t& e : full) e = 1 + static_cast<std::int64_t>(generator() % 5);
    if (rank > 0 && trial % 4 == 0) full.back() = 19;
    const auto reduced = [&] {
      std::vector<std::int64_t> s(
          full.begin() + static_cast<std::ptrdiff_t>(rank > 0 ? generator() % (rank + 1) : 0), full.end());
      for (std::int64_t& e : s)
        if (generator() % 3 == 0) e = 1;
      return s;
    };
    const std::vector<std::int64_t> sa = reduced();
    const std::vector<std::int64_t> sb = reduced();
    const Tensor a = random_tensor(Shape(sa), 10 + static_cast<unsigned>(trial));
    const Tensor b = random_tensor(Shape(sb), 100 + static_cast<unsigned>(trial));
    const Call call = binary_call(a, b, kBinary[trial % 6]);
    const Tensor y = call.reference();
    for (std::int64_t i = 0; i < y.count(); ++i) {
      // The operand's element: coordinates counted from the last axis, extents of 1 always at 0.
      const auto element = [&](const Tensor& t) {
        std::int64_t rest = i;
        std::int64_t at = 0;
        std::int64_t size = 1;
        for (int axis = 1; axis <= t.shape().rank(); ++axis) {
          const std::int64_t coordinate = rest % y.shape()[-axis];
          rest /= y.shape()[-axis];
          at += (t.shape()[-axis] == 1 ? 0 : coordinate) * size;
          size *= t.shape()[-axis];
        }
        return t.data<double>()[static_cast<std::size_t>(at)];
      };
      const double u = element(a);
      const double v = element(b);
      const double expected[] = {u + v, u - v, u * v, u / v, std::fmin(u, v), std::fmax(u, v)};
      REQUIRE(y.data<double>()[static_cast<std::size_t>(i)] == expected[trial % 6]);
    }
    test::judge(call);
  }
}

TEST_CASE("long rows are cut between threads without a seam") {
  const Tensor a = random_tensor({2, 3, 1, 40000}, 1);
  const Tensor b = random_tensor({3, 2, 1}, 2);
  test::judge(binary_call(a, b, ops::mul));
  test::judge(call_of(a, [](Value x) { return ops::sigmoid(x); }));
}

TEST_CASE("shapes that do not broadcast and attributes that make no sense are refused by name") {
  Graph g;
  const Value a = g.input("a", {2, 3});
  const Value b = g.input("b", {4, 3});
  CHECK(test::refusal([&] { (void)ops::add(a, b); }) ==
        "layer add: the shapes 2x3 and 4x3 do not broadcast: extents 2 and 4");
  CHECK(test::refusal([&] { (void)ops::clip(a, 1, 0); }).find("clip from 1 to 0") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::elu(a, std::nan("")); }).find("beyond the range") !=
        std::string::npos);
  CHECK(test::refusal([&] { (void)ops::affine(a, 1e300, 0); }).find("beyond the range") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::greater(a, std::nan("")); }).find("NaN") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::clip(a, -INFINITY, 1e300); }).empty());
}
