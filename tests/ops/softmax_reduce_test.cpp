#include <cmath>
#include <limits>

#include "judge.h"
#include "ops/reduce/reduce.h"
#include "ops/softmax/softmax.h"

using namespace slide;
using test::Call;
using test::call_of;
using test::random_tensor;
using test::tensor_by;
using test::tensor_of;
using test::values;

TEST_CASE("a softmax of equal values is uniform, however large they are") {
  for (const double value : {0.0, 1000.0, -1e30}) {
    const Call call = call_of(tensor_by({4, 8}, [&](std::int64_t) { return value; }),
                              [](Value x) { return ops::softmax(x, -1); });
    for (const double v : values(call.reference())) CHECK(v == 0.125);
    test::judge(call);
  }
}

TEST_CASE("softmax of two values is the sigmoid of their difference") {
  const Call call = call_of(tensor_of({1, 2}, {0.75, 2.0}), [](Value x) { return ops::softmax(x, 1); });
  CHECK(std::fabs(values(call.reference())[0] - 1 / (1 + std::exp(1.25))) < 1e-15);
}

TEST_CASE("softmax kernels keep their bound along every axis, for spreads from none to underflow") {
  for (const double sigma : {0.1, 3.0, 60.0})
    for (int axis = 0; axis < 4; ++axis)
      test::judge(call_of(random_tensor({2, 3, 5, 37}, static_cast<unsigned>(axis), sigma),
                          [&](Value x) { return ops::softmax(x, axis); }));
  for (const std::int64_t n : {1, 2, 15, 16, 17, 300})
    test::judge(call_of(random_tensor({3, n}, 1, 5), [](Value x) { return ops::softmax(x, 1); }));
  test::judge(call_of(random_tensor({7, 600}, 1, 5), [](Value x) { return ops::softmax(x, 0); }));
}

TEST_CASE("a value of minus infinity has no weight in a softmax, and NaN spreads along its line only") {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  const Call call = call_of(tensor_of({2, 3}, {1, -kInf, 1, std::nan(""), 0, 0}),
                            [](Value x) { return ops::softmax(x, 1); });
  const std::vector<double> y = values(call.reference());
  CHECK(std::vector<double>(y.begin(), y.begin() + 3) == std::vector<double>{0.5, 0, 0.5});
  for (std::size_t i = 3; i < 6; ++i) CHECK(std::isnan(y[i]));
  test::judge(call);
}

TEST_CASE("reductions over every set of axes agree with a search through all elements") {
  const Shape shape{2, 3, 4, 19};
  const Tensor x = random_tensor(shape, 1);
  const std::vector<double> all = values(x);
  for (unsigned set = 1; set < 16; ++set) {
    std::vector<int> axes;
    for (int axis = 0; axis < 4; ++axis)
      if ((set >> axis & 1u) != 0) axes.push_back(axis % 2 == 0 ? axis : axis - 4);  // negative ones too
    const auto reduce = [&](Value (*f)(Value, const std::vector<int>&)) {
      const Call call = call_of(x, [&](Value v) { return f(v, axes); });
      test::judge(call);
      return call.reference();
    };
    const Tensor least = reduce(ops::reduce_min);
    const Tensor largest = reduce(ops::reduce_max);
    const Tensor mean = reduce(ops::reduce_mean);
    for (std::int64_t to = 0; to < least.count(); ++to) {
      double low = INFINITY;
      double high = -INFINITY;
      long double sum = 0;
      std::int64_t count = 0;
      for (std::int64_t i = 0; i < x.count(); ++i) {
        std::int64_t rest_in = i;
        std::int64_t rest_out = to;
        bool same = true;
        for (int axis = 3; axis >= 0; --axis) {
          const std::int64_t c = rest_in % shape[axis];
          rest_in /= shape[axis];
          if ((set >> axis & 1u) != 0) continue;
          same = same && c == rest_out % shape[axis];
          rest_out /= shape[axis];
        }
        if (!same) continue;
        const double v = all[static_cast<std::size_t>(i)];
        low = std::min(low, v);
        high = std::max(high, v);
        sum += v;
        ++count;
      }
      const auto at = static_cast<std::size_t>(to);
      REQUIRE(least.data<double>()[at] == low);
      REQUIRE(largest.data<double>()[at] == high);
      REQUIRE(std::fabs(mean.data<double>()[at] - static_cast<double>(sum / count)) < 1e-14);
    }
  }
}

TEST_CASE("NaN and extents of one pass through reductions") {
  const Tensor x =
      tensor_by({2, 1, 40}, [](std::int64_t i) { return i == 57 ? std::nan("") : static_cast<double>(i); });
  for (const auto f : {ops::reduce_min, ops::reduce_max, ops::reduce_mean}) {
    const Call call = call_of(x, [&](Value v) { return f(v, {2}); });
    CHECK_FALSE(std::isnan(values(call.reference())[0]));
    CHECK(std::isnan(values(call.reference())[1]));
    test::judge(call);
    test::judge(call_of(x, [&](Value v) { return f(v, {0}); }));
    test::judge(call_of(x, [&](Value v) { return f(v, {1}); }));
  }
  test::judge(call_of(tensor_of({1, 1}, {3}), [](Value v) { return ops::reduce_mean(v, {0}); }));
}

TEST_CASE("axes that do not exist or come twice are refused") {
  Graph g;
  const Value x = g.input("x", {2, 3});
  CHECK(test::refusal([&] { (void)ops::reduce_max(x, {2}); }).find("axis 2 of a tensor of shape 2x3") !=
        std::string::npos);
  CHECK(test::refusal([&] { (void)ops::reduce_max(x, {1, -1}); }).find("twice") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::reduce_max(x, {}); }).find("no axis") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::softmax(x, -3); }).find("axis -3") != std::string::npos);
}
