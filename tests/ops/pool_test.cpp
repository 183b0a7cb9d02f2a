#include "ops/pool/pool.h"

#include <cmath>
#include <limits>

#include "judge.h"

using namespace slide;
using test::Call;
using test::call_of;
using test::random_tensor;

namespace {

ops::PoolParams params(std::array<std::int64_t, 2> kernel, std::array<std::int64_t, 2> stride,
                       std::array<std::int64_t, 4> padding = {0, 0, 0, 0}, bool ceil = false) {
  ops::PoolParams p;
  p.kernel = kernel;
  p.stride = stride;
  p.padding = padding;
  p.ceil_mode = ceil;
  return p;
}

const std::vector<ops::PoolParams>& windows() {
  static const std::vector<ops::PoolParams> all = {
      params({2, 2}, {2, 2}),
      params({2, 2}, {2, 2}, {0, 0, 0, 0}, true),
      params({3, 3}, {2, 2}, {1, 1, 1, 1}),
      params({3, 3}, {1, 1}, {1, 1, 1, 1}),
      params({3, 3}, {2, 2}, {0, 0, 1, 1}, true),
      params({5, 1}, {1, 1}, {4, 0, 4, 0}),
      params({1, 7}, {3, 3}, {0, 6, 0, 2}, true),
      params({4, 6}, {5, 7}),
  };
  return all;
}

}  // namespace

TEST_CASE("pooling kernels keep their bounds at every width around the vector width") {
  for (const ops::PoolParams& p : windows())
    for (const std::int64_t width : {7, 8, 16, 17, 33, 50}) {
      const Tensor x = random_tensor({2, 2, 9, width}, static_cast<unsigned>(width));
      test::judge(call_of(x, [&](Value v) { return ops::max_pool2d(v, p); }));
      for (const bool counted : {false, true}) {
        ops::PoolParams q = p;
        q.count_include_pad = counted;
        test::judge(call_of(x, [&](Value v) { return ops::avg_pool2d(v, q); }));
      }
    }
}

TEST_CASE(
    "the mean of numbers whose sum is beyond float32 is that of the definition, also beside an infinity") {
  constexpr double kLarge = 0x1.8p127;
  for (const double other : {kLarge, -kLarge, std::numeric_limits<double>::infinity(), std::nan("")}) {
    const Tensor x =
        test::tensor_by({1, 2, 7, 40}, [&](std::int64_t i) { return i == 2 * 40 + 20 ? other : kLarge; });
    const Call call = call_of(x, [](Value v) {
      return ops::avg_pool2d(v, params({3, 3}, {1, 1}, {1, 1, 1, 1}));
    });
    CHECK(test::values(call.reference())[0] == kLarge);
    test::judge(call);
  }
}

TEST_CASE("NaN reaches every window that contains it and no other; padding never wins a maximum") {
  const Tensor x =
      test::tensor_by({1, 1, 5, 40}, [](std::int64_t i) { return i == 2 * 40 + 20 ? std::nan("") : -5.0; });
  const Call call = call_of(x, [](Value v) {
    return ops::max_pool2d(v, params({3, 3}, {1, 1}, {1, 1, 1, 1}));
  });
  const std::vector<double> y = test::values(call.reference());
  for (std::int64_t i = 0; i < 5; ++i)
    for (std::int64_t j = 0; j < 40; ++j) {
      const double value = y[static_cast<std::size_t>(i * 40 + j)];
      if (std::abs(i - 2) <= 1 && std::abs(j - 20) <= 1)
        CHECK(std::isnan(value));
      else
        CHECK(value == -5.0);
    }
  test::judge(call);
}

TEST_CASE("halving keeps NaN, and takes what is left at odd ends as it is") {
  const Tensor x = test::tensor_by({1, 1, 5, 41}, [](std::int64_t i) {
    return i == 2 * 41 + 20 ? std::nan("") : -static_cast<double>(i);
  });
  const Call call = call_of(x, [](Value v) {
    return ops::max_pool2d(v, params({2, 2}, {2, 2}, {0, 0, 0, 0}, true));
  });
  const std::vector<double> y = test::values(call.reference());
  for (std::int64_t i = 0; i < 3; ++i)
    for (std::int64_t j = 0; j < 21; ++j) {
      const double value = y[static_cast<std::size_t>(i * 21 + j)];
      if (i == 1 && j == 10)
        CHECK(std::isnan(value));
      else
        CHECK(value == -static_cast<double>(2 * i * 41 + 2 * j));
    }
  test::judge(call);
}

TEST_CASE("any mean of a constant is the constant") {
  const Tensor x = test::tensor_by({1, 3, 13, 21}, [](std::int64_t) { return 0.3125; });
  const auto all_equal = [&](const Call& call) {
    for (const double v : test::values(call.reference())) CHECK(v == 0.3125);
    test::judge(call);
  };
  all_equal(call_of(x, [](Value v) { return ops::global_avg_pool2d(v); }));
  for (const std::int64_t size : {1, 2, 3, 6, 13, 20})
    all_equal(call_of(x, [&](Value v) { return ops::adaptive_avg_pool2d(v, size, size + 1); }));
  all_equal(call_of(x, [](Value v) {
    return ops::avg_pool2d(v, params({3, 3}, {2, 2}, {1, 1, 1, 1}, true));
  }));
}

TEST_CASE("adaptive pooling keeps its bound on planes of many sizes") {
  for (const std::int64_t width : {1, 2, 15, 16, 17, 64})
    for (const std::int64_t size : {1, 2, 3, 6})
      test::judge(call_of(random_tensor({1, 3, 7, width}, static_cast<unsigned>(width)),
                          [&](Value v) { return ops::adaptive_avg_pool2d(v, size, 2 * size - 1); }));
}

TEST_CASE("windows that make no sense are refused") {
  Graph g;
  const Value x = g.input("x", {1, 2, 5, 5});
  const auto why = [&](const ops::PoolParams& p) {
    return test::refusal([&] { (void)ops::max_pool2d(x, p); });
  };
  CHECK(why(params({6, 2}, {1, 1})).find("does not fit into 1x2x5x5") != std::string::npos);
  CHECK(why(params({2, 2}, {1, 1}, {2, 0, 0, 0})).find("less than the kernel") != std::string::npos);
  CHECK(why(params({2, 2}, {0, 1})).find("stride is 0") != std::string::npos);
  CHECK(why(params({0, 2}, {1, 1})).find("kernel is 0") != std::string::npos);
  CHECK(why(params({std::int64_t{1} << 62, 1}, {1, 1})).find("too large") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::adaptive_avg_pool2d(x, 0, 1); }).find("0x1") != std::string::npos);
  const Value flat = g.input("flat", {5, 5});
  CHECK(test::refusal([&] { (void)ops::global_avg_pool2d(flat); }).find("5x5") != std::string::npos);
}
