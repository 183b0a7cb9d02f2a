#include "ops/conv2d/conv2d.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <set>

#include "judge.h"
#include "kernel_bounds.h"
#include "runtime/error.h"
#include "tests/quick.h"

using namespace slide;
using test::Call;
using test::random_tensor;

namespace {

Call conv(std::vector<Tensor> inputs, const ops::Conv2dParams& params) {
  return {std::move(inputs), [&](const std::vector<Value>& v) {
            return ops::conv2d(v[0], v[1], v.size() > 2 ? std::optional(v[2]) : std::nullopt, params);
          }};
}

/// The definition once more, one output at a time, in long double.
Tensor one_by_one(const Call& call, const ops::Conv2dParams& p) {
  const Tensor& x = call.inputs[0];
  const Tensor& w = call.inputs[1];
  const auto at = [](const Tensor& t, std::int64_t a, std::int64_t b, std::int64_t c, std::int64_t d) {
    const Shape& s = t.shape();
    return t.data<double>()[static_cast<std::size_t>(((a * s[1] + b) * s[2] + c) * s[3] + d)];
  };
  Tensor y(DType::kF64, call.shape);
  std::size_t index = 0;
  for (std::int64_t n = 0; n < call.shape[0]; ++n)
    for (std::int64_t o = 0; o < call.shape[1]; ++o)
      for (std::int64_t i = 0; i < call.shape[2]; ++i)
        for (std::int64_t j = 0; j < call.shape[3]; ++j) {
          long double sum = 0;
          for (std::int64_t c = 0; c < w.shape()[1]; ++c)
            for (std::int64_t u = 0; u < w.shape()[2]; ++u)
              for (std::int64_t v = 0; v < w.shape()[3]; ++v) {
                const std::int64_t row = i * p.stride[0] + u * p.dilation[0] - p.padding[0];
                const std::int64_t column = j * p.stride[1] + v * p.dilation[1] - p.padding[1];
                if (row < 0 || row >= x.shape()[2] || column < 0 || column >= x.shape()[3]) continue;
                const std::int64_t channel = o / (call.shape[1] / p.groups) * w.shape()[1] + c;
                sum += static_cast<long double>(at(w, o, c, u, v)) * at(x, n, channel, row, column);
              }
          if (call.inputs.size() > 2) sum += call.inputs[2].data<double>()[static_cast<std::size_t>(o)];
          y.mutable_data<double>()[index++] = static_cast<double>(sum);
        }
  return y;
}

struct Case {
  const char* what;
  Shape x;
  Shape weight;
  ops::Conv2dParams params;
};

/// Every attribute, alone and together, and the shapes at which loops end.
const std::vector<Case>& cases() {
  static const std::vector<Case> all = {
      {"3x3", {1, 5, 9, 17}, {7, 5, 3, 3}, ops::Conv2dParams::same(3)},
      {"1x1", {1, 9, 5, 7}, {13, 9, 1, 1}, {}},
      {"1x1 with stride", {1, 6, 9, 7}, {8, 6, 1, 1}, {{2, 2}, {0, 0, 0, 0}, {1, 1}, 1}},
      {"1x1 with padding", {1, 3, 4, 5}, {4, 3, 1, 1}, {{1, 1}, {1, 2, 0, 1}, {1, 1}, 1}},
      {"one pixel", {1, 3, 1, 1}, {5, 3, 1, 1}, {}},
      {"one pixel, 3x3", {1, 3, 1, 1}, {5, 3, 3, 3}, ops::Conv2dParams::same(3)},
      {"a kernel larger than the input", {1, 2, 2, 3}, {3, 2, 7, 5}, {{1, 1}, {3, 2, 3, 2}, {1, 1}, 1}},
      {"stride 2", {1, 4, 13, 34}, {6, 4, 3, 3}, ops::Conv2dParams::same(3, 2)},
      {"7x7 stride 2", {1, 3, 21, 37}, {9, 3, 7, 7}, ops::Conv2dParams::same(7, 2)},
      {"unequal strides", {1, 3, 9, 20}, {4, 3, 3, 2}, {{3, 2}, {1, 0, 1, 1}, {1, 1}, 1}},
      {"asymmetric padding", {1, 3, 8, 9}, {4, 3, 3, 3}, {{2, 2}, {0, 0, 1, 1}, {1, 1}, 1}},
      {"more padding than the kernel reaches", {1, 2, 3, 4}, {3, 2, 3, 3}, {{1, 1}, {5, 4, 3, 6}, {1, 1}, 1}},
      {"dilation", {1, 3, 17, 19}, {5, 3, 3, 3}, ops::Conv2dParams::same(3, 1, 4)},
      {"dilation beyond the input", {1, 3, 6, 7}, {5, 3, 3, 3}, ops::Conv2dParams::same(3, 1, 8)},
      {"dilation and stride", {1, 3, 15, 18}, {5, 3, 3, 3}, ops::Conv2dParams::same(3, 2, 2)},
      {"groups", {1, 12, 7, 21}, {18, 4, 3, 3}, ops::Conv2dParams::same(3, 1, 1, 3)},
      {"groups with stride", {2, 16, 9, 9}, {16, 8, 3, 3}, ops::Conv2dParams::same(3, 2, 1, 2)},
      {"depthwise 3x3", {1, 11, 9, 35}, {11, 1, 3, 3}, ops::Conv2dParams::same(3, 1, 1, 11)},
      {"depthwise 5x5 stride 2", {2, 5, 12, 37}, {5, 1, 5, 5}, ops::Conv2dParams::same(5, 2, 1, 5)},
      {"depthwise with asymmetric padding", {1, 6, 8, 18}, {6, 1, 3, 3}, {{2, 2}, {0, 0, 1, 1}, {1, 1}, 6}},
      {"depthwise dilated", {1, 3, 11, 40}, {3, 1, 3, 3}, ops::Conv2dParams::same(3, 1, 3, 3)},
      {"depthwise on one pixel", {1, 3, 1, 1}, {3, 1, 5, 5}, ops::Conv2dParams::same(5, 1, 1, 3)},
      {"depthwise 5x5 of half a vector", {2, 3, 8, 8}, {3, 1, 5, 5}, ops::Conv2dParams::same(5, 1, 1, 3)},
      {"depthwise 5x5 of a quarter of one", {1, 3, 5, 4}, {3, 1, 5, 5}, ops::Conv2dParams::same(5, 1, 1, 3)},
      {"depthwise over uneven rows", {1, 2, 13, 23}, {2, 1, 5, 5}, ops::Conv2dParams::same(5, 1, 1, 2)},
      {"depthwise of whole vectors", {1, 2, 10, 64}, {4, 1, 3, 3}, ops::Conv2dParams::same(3, 1, 1, 2)},
      {"depthwise halved", {2, 3, 14, 24}, {3, 1, 5, 5}, ops::Conv2dParams::same(5, 2, 1, 3)},
      {"depthwise halved, wide", {1, 2, 18, 100}, {2, 1, 3, 3}, {{2, 2}, {0, 0, 1, 1}, {1, 1}, 2}},
      {"depthwise halved to one pixel", {1, 2, 2, 2}, {2, 1, 3, 3}, ops::Conv2dParams::same(3, 2, 1, 2)},
      {"depthwise of one row", {1, 2, 9, 16}, {2, 1, 1, 7}, {{1, 1}, {0, 6, 0, 0}, {1, 1}, 2}},
      {"two filters a channel", {1, 4, 6, 20}, {8, 1, 3, 3}, ops::Conv2dParams::same(3, 1, 1, 4)},
      {"batch 2, odd channels", {2, 3, 6, 11}, {1, 3, 3, 3}, ops::Conv2dParams::same(3)},
      {"many channels", {1, 70, 6, 8}, {65, 70, 3, 3}, ops::Conv2dParams::same(3)},
      {"rows of one pixel", {1, 4, 40, 1}, {4, 4, 3, 3}, ops::Conv2dParams::same(3)},
      {"several blocks of positions", {1, 4, 40, 61}, {20, 4, 3, 3}, ops::Conv2dParams::same(3)},
      {"several blocks of terms", {1, 128, 5, 7}, {18, 128, 3, 3}, ops::Conv2dParams::same(3)},
      {"one filter of many channels", {1, 40, 50, 130}, {1, 40, 3, 3}, ops::Conv2dParams::same(3)},
      {"many filters along long rows", {1, 24, 21, 81}, {70, 24, 3, 3}, ops::Conv2dParams::same(3)},
      {"many filters along long rows, stride 2",
       {1, 9, 24, 130},
       {33, 9, 5, 5},
       ops::Conv2dParams::same(5, 2)},
      {"groups of few filters", {1, 32, 40, 50}, {32, 4, 3, 3}, ops::Conv2dParams::same(3, 1, 1, 8)},
      {"groups of many filters, stride 2",
       {1, 48, 31, 40},
       {80, 24, 3, 3},
       ops::Conv2dParams::same(3, 2, 1, 2)},
      {"1x1 of many filters with stride", {1, 40, 15, 33}, {40, 40, 1, 1}, {{2, 2}, {0, 0, 0, 0}, {1, 1}, 1}},
      {"1x1 of one filter, whole vectors", {1, 33, 16, 36}, {1, 33, 1, 1}, {}},
      {"1x1 of one filter, several bands", {2, 19, 41, 47}, {1, 19, 1, 1}, {}},
      {"1x1 of two filters", {1, 7, 13, 80}, {2, 7, 1, 1}, {}},
      {"1x1 of three filters, several bands", {1, 6, 50, 83}, {3, 6, 1, 1}, {}},
      {"1x1 of four filters of one pixel", {2, 17, 1, 1}, {4, 17, 1, 1}, {}},
      {"one filter, narrower than a vector", {1, 9, 21, 3}, {1, 9, 3, 3}, ops::Conv2dParams::same(3)},
      {"one filter on one row", {1, 3, 1, 40}, {1, 3, 3, 5}, {{1, 1}, {1, 2, 1, 2}, {1, 1}, 1}},
      {"one filter of very many channels", {1, 300, 6, 19}, {1, 300, 3, 3}, ops::Conv2dParams::same(3)},
      {"one filter 5x5", {2, 5, 19, 37}, {1, 5, 5, 5}, ops::Conv2dParams::same(5)},
      {"one filter 7x7", {1, 3, 11, 70}, {1, 3, 7, 7}, ops::Conv2dParams::same(7)},
      {"one filter 7x1", {1, 3, 23, 18}, {1, 3, 7, 1}, {{1, 1}, {3, 0, 3, 0}, {1, 1}, 1}},
      {"one filter, valid", {1, 4, 12, 37}, {1, 4, 3, 3}, {}},
      {"one filter, more padding than it reaches",
       {1, 2, 5, 6},
       {1, 2, 3, 3},
       {{1, 1}, {9, 17, 6, 20}, {1, 1}, 1}},
      {"one filter dilated", {1, 4, 25, 39}, {1, 4, 3, 3}, ops::Conv2dParams::same(3, 1, 3)},
      {"one filter dilated beyond the input", {1, 3, 6, 7}, {1, 3, 3, 3}, ops::Conv2dParams::same(3, 1, 8)},
      {"two filters", {1, 11, 17, 50}, {2, 11, 3, 3}, ops::Conv2dParams::same(3)},
      {"two filters 7x3, dilated", {2, 4, 18, 33}, {2, 4, 7, 3}, {{1, 1}, {6, 1, 6, 1}, {2, 1}, 1}},
      {"three filters 5x7", {1, 6, 14, 34}, {3, 6, 5, 7}, {{1, 1}, {2, 3, 2, 3}, {1, 1}, 1}},
      {"four filters", {2, 24, 13, 61}, {4, 24, 3, 3}, ops::Conv2dParams::same(3)},
      {"four filters 7x7", {1, 8, 9, 40}, {4, 8, 7, 7}, ops::Conv2dParams::same(7)},
      {"two filters 4x4", {1, 5, 12, 30}, {2, 5, 4, 4}, {}},
  };
  return all;
}

std::vector<Tensor> random_inputs(const Case& c, bool bias) {
  std::vector<Tensor> inputs = {random_tensor(c.x, 1), random_tensor(c.weight, 2)};
  if (bias) inputs.push_back(random_tensor({c.weight[0]}, 3));
  return inputs;
}

}  // namespace

TEST_CASE("the float64 convolution is the sum of its definition" * doctest::skip(test::quick())) {
  for (const Case& c : cases())
    for (const bool bias : {false, true}) {
      INFO(c.what, " bias ", bias);
      const Call call = conv(random_inputs(c, bias), c.params);
      const Tensor y = call.reference();
      const Tensor scale = call.error_scale(y);
      const Tensor expected = one_by_one(call, c.params);
      for (std::size_t i = 0; i < static_cast<std::size_t>(y.count()); ++i)
        REQUIRE(std::fabs(y.data<double>()[i] - expected.data<double>()[i]) <=
                0x1p-48 * scale.data<double>()[i]);
    }
}

TEST_CASE("a kernel of a single one shifts the image") {
  const Tensor x = random_tensor({1, 1, 6, 7}, 5);
  for (std::size_t u = 0; u < 3; ++u)
    for (std::size_t v = 0; v < 3; ++v) {
      Tensor delta = Tensor::zeros(DType::kF64, {1, 1, 3, 3});
      delta.mutable_data<double>()[u * 3 + v] = 1;
      const Tensor y = conv({x, delta}, ops::Conv2dParams::same(3)).reference();
      for (std::size_t i = 0; i < 6; ++i)
        for (std::size_t j = 0; j < 7; ++j) {
          const std::size_t row = i + u - 1;  // wraps to a large number above the image
          const std::size_t column = j + v - 1;
          const double expected = row < 6 && column < 7 ? x.data<double>()[row * 7 + column] : 0;
          CHECK(y.data<double>()[i * 7 + j] == expected);
        }
    }
}

TEST_CASE("a constant image gives the kernel's sum, inside") {
  Tensor x(DType::kF64, {1, 2, 7, 8});
  std::ranges::fill(x.mutable_data<double>(), 2.0);
  const Tensor w = Tensor::from<double>({1, 2, 2, 2}, std::vector<double>{1, 2, 3, 4, 5, 6, 7, 8});
  const Tensor bias = Tensor::from<double>({1}, std::vector<double>{0.5});
  const Tensor y = conv({x, w, bias}, {}).reference();
  for (const double v : y.data<double>()) CHECK(v == 2 * 36 + 0.5);
}

TEST_CASE("a separable kernel is a row and a column kernel one after the other") {
  const Tensor x = random_tensor({1, 1, 9, 10}, 6);
  const Tensor column = random_tensor({1, 1, 3, 1}, 7);
  const Tensor row = random_tensor({1, 1, 1, 5}, 8);
  Tensor product(DType::kF64, {1, 1, 3, 5});
  for (std::size_t i = 0; i < 15; ++i)
    product.mutable_data<double>()[i] = column.data<double>()[i / 5] * row.data<double>()[i % 5];
  const Tensor once = conv({x, product}, {}).reference();
  const Tensor twice = conv({conv({x, column}, {}).reference(), row}, {}).reference();
  CHECK(max_abs_difference(once, twice) <= 1e-14 * max_abs(once));
}

TEST_CASE("convolution is linear in its input, and groups are convolutions of their own") {
  const ops::Conv2dParams params = ops::Conv2dParams::same(3);
  const Tensor x = random_tensor({1, 4, 6, 7}, 9);
  const Tensor w = random_tensor({6, 2, 3, 3}, 10);
  ops::Conv2dParams grouped = params;
  grouped.groups = 2;
  const Tensor y = conv({x, w}, grouped).reference();
  for (std::size_t group = 0; group < 2; ++group) {
    const Tensor xg = Tensor::from<double>({1, 2, 6, 7}, x.data<double>().subspan(group * 84, 84));
    const Tensor wg = Tensor::from<double>({3, 2, 3, 3}, w.data<double>().subspan(group * 54, 54));
    const Tensor yg = conv({xg, wg}, params).reference();
    for (std::size_t i = 0; i < 126; ++i) CHECK(y.data<double>()[group * 126 + i] == yg.data<double>()[i]);
  }
  Tensor doubled = x.clone();
  for (double& v : doubled.mutable_data<double>()) v *= 2;
  const Tensor y2 = conv({doubled, w}, grouped).reference();
  for (std::size_t i = 0; i < 252; ++i) CHECK(y2.data<double>()[i] == 2 * y.data<double>()[i]);
}

TEST_CASE("a convolution names what does not fit, layer and shapes") {
  const auto call = [](const Shape& x, const Shape& w, const ops::Conv2dParams& params) {
    return conv({Tensor::zeros(DType::kF64, x), Tensor::zeros(DType::kF64, w)}, params);
  };
  CHECK_THROWS_WITH_AS(
      call({1, 3, 8, 8}, {4, 2, 3, 3}, {}),
      "layer conv2d: an input of shape 1x3x8x8 and a weight of shape 4x2x3x3 with 1 groups do not "
      "fit",
      Error);
  CHECK_THROWS_WITH_AS(call({1, 3, 2, 8}, {4, 3, 3, 3}, {}),
                       "layer conv2d: the kernel's height reaches over 3, the padded input has 2", Error);
  CHECK_THROWS_AS(call({1, 3, 8, 8}, {4, 3, 3, 3}, {{0, 1}, {0, 0, 0, 0}, {1, 1}, 1}), Error);
  CHECK_THROWS_AS(call({1, 3, 8, 8}, {4, 3, 3, 3}, {{1, 1}, {0, -1, 0, 0}, {1, 1}, 1}), Error);
  CHECK_THROWS_AS(call({1, 3, 8, 8}, {4, 3, 3, 3}, {{1, 1}, {0, 0, 0, 0}, {std::int64_t{1} << 62, 1}, 1}),
                  Error);
  CHECK_THROWS_AS(call({1, 3, 8, 8}, {4, 3, 3, 3}, {{1, 1}, {0, 0, 0, 0}, {1, 1}, 0}), Error);
  CHECK_THROWS_AS(call({3, 8, 8}, {4, 3, 3, 3}, {}), Error);
  CHECK_THROWS_AS(conv({Tensor::zeros(DType::kF64, {1, 3, 8, 8}), Tensor::zeros(DType::kF64, {4, 3, 3, 3}),
                        Tensor::zeros(DType::kF64, {3})},
                       {}),
                  Error);
}

TEST_CASE("every kernel of the convolution keeps its bound on every shape") {
  for (const Case& c : cases())
    for (const bool bias : {false, true}) {
      INFO(c.what, " bias ", bias);
      const Call call = conv(random_inputs(c, bias), c.params);
      const auto levels = test::whole_levels();
      CHECK(check_kernels(call) >= levels * (c.weight[1] == 1 ? 2 : 1));
    }
}

TEST_CASE("a single filter, which waits for its input, is computed in float32 at any precision") {
  const auto precisions = [](const Shape& weight) {
    const Call call =
        conv({random_tensor({1, 16, 8, 40}, 1), random_tensor(weight, 2)}, ops::Conv2dParams::same(3));
    int lower = 0;
    bool few = false;
    for (const Kernel* kernel : call.op->kernels()) {
      if (!kernel->supports(*call.op, call.input_shapes(), call.shape)) continue;
      lower += kernel->precision() != Precision::kFp32 ? 1 : 0;
      few = few || kernel->name() == "conv2d.few_filters";
    }
    return std::pair(few, lower > 0);
  };
  CHECK(precisions({1, 16, 3, 3}) == std::pair(true, false));
  CHECK(precisions({4, 16, 3, 3}) == std::pair(true, true));
  CHECK(precisions({5, 16, 3, 3}) == std::pair(false, true));
}

TEST_CASE("products of lower precision have kernels of their own where there are instructions for them") {
  const Call call =
      conv({random_tensor({1, 16, 8, 40}, 1), random_tensor({16, 16, 3, 3}, 2)}, ops::Conv2dParams::same(3));
  const auto precisions_at = [&](Isa isa) {
    std::set<Precision> found;
    for (const Kernel* kernel : call.op->kernels())
      if (kernel->isa() == isa) found.insert(kernel->precision());
    return found;
  };
  using All = std::set<Precision>;
#if defined(__x86_64__)
  for (const Isa isa : {Isa::kAvxVnni, Isa::kAvx512Vnni}) CHECK(precisions_at(isa) == All{Precision::kInt8});
  CHECK(precisions_at(Isa::kAvx512Bf16).size() == 3);
  CHECK(precisions_at(Isa::kAmx) == All{Precision::kBf16, Precision::kInt8});
#elif defined(__aarch64__)
  for (const Isa isa : {Isa::kNeonDot, Isa::kNeonI8mm}) CHECK(precisions_at(isa) == All{Precision::kInt8});
  CHECK(precisions_at(Isa::kNeonBf16) == All{Precision::kBf16});
#endif
  CHECK(precisions_at(Isa::kBaseline).size() == 3);
}

TEST_CASE("the bound holds where sums cancel") {
  // Each product comes with its negative, far away in the order of summation, and one small term remains.
  Tensor x = random_tensor({1, 200, 4, 5}, 11, 1000.0);
  Tensor w = random_tensor({3, 200, 1, 1}, 12);
  const std::span<double> values = x.mutable_data<double>();
  const std::span<double> weights = w.mutable_data<double>();
  for (std::size_t c = 100; c < 200; ++c) {
    for (std::size_t i = 0; i < 20; ++i) values[c * 20 + i] = values[(c - 100) * 20 + i];
    for (std::size_t o = 0; o < 3; ++o) weights[o * 200 + c] = -weights[o * 200 + c - 100];
  }
  values[0] = 1e-3;
  CHECK(check_kernels(conv({x, w}, {})) > 0);
}

TEST_CASE("the bound holds for long sums of equal terms, whose roundings all go one way") {
  // 0.1 is rounded up in float32, and adding it again and again rounds the same way for long stretches.
  for (const std::int64_t channels : {1L, 31L, 33L, 1000L, 5000L}) {
    INFO(channels);
    Tensor x(DType::kF64, {1, channels, 1, 3});
    Tensor w(DType::kF64, {2, channels, 1, 1});
    std::ranges::fill(x.mutable_data<double>(), static_cast<double>(0.1F));
    std::ranges::fill(w.mutable_data<double>(), static_cast<double>(0.7F));
    CHECK(check_kernels(conv({x, w}, {})) > 0);
  }
}

TEST_CASE("the bound holds over a large dynamic range") {
  Tensor x = random_tensor({1, 40, 5, 6}, 13);
  Tensor w = random_tensor({7, 40, 3, 3}, 14);
  std::mt19937 generator(15);
  for (double& v : x.mutable_data<double>()) v = std::ldexp(v, static_cast<int>(generator() % 60) - 30);
  for (double& v : w.mutable_data<double>()) v = std::ldexp(v, static_cast<int>(generator() % 60) - 30);
  CHECK(check_kernels(conv({x, w}, ops::Conv2dParams::same(3))) > 0);
}

TEST_CASE("the bound holds for denormal operands and results, flushed to zero or not") {
  for (const bool flush : {false, true})
    for (const int exponent : {-20, -100, -130}) {
      INFO(flush, " ", exponent);
      Tensor x = random_tensor({1, 8, 6, 20}, 16);
      Tensor w = random_tensor({8, 8, 3, 3}, 17);
      for (double& v : x.mutable_data<double>())
        v = static_cast<double>(static_cast<float>(std::ldexp(v, exponent)));
      for (double& v : w.mutable_data<double>())
        v = static_cast<double>(static_cast<float>(std::ldexp(v, -20)));
      CHECK(check_kernels(conv({x, w}, ops::Conv2dParams::same(3)), flush) > 0);
      const Tensor depthwise = random_tensor({8, 1, 3, 3}, 18);
      CHECK(check_kernels(conv({x, depthwise}, ops::Conv2dParams::same(3, 1, 1, 8)), flush) > 0);
    }
}

TEST_CASE("a NaN or an infinity never becomes a number and never leaves its image") {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity()})
    for (const std::int64_t k : {1, 3}) {
      Tensor x = random_tensor({2, 24, 10, 19}, 61);
      x.mutable_data<double>()[700] = bad;
      const Tensor w = random_tensor({20, 24, k, k}, 62, 0.1);
      const Tensor b = random_tensor({20}, 63);
      test::judge(conv({x, w, b}, ops::Conv2dParams::same(k)));
      Tensor spoiled = w.clone();
      spoiled.mutable_data<double>()[300] = bad;
      test::judge(conv({random_tensor({2, 24, 10, 19}, 64), spoiled, b}, ops::Conv2dParams::same(k)));
    }
}

TEST_CASE("the bound holds up to the ends of each kernel's domain") {
  for (const double largest : {0x1p100, 0x1p120, 0x1.FEp127, 0x1.FFFFFEp127}) {
    Tensor x = random_tensor({1, 8, 9, 18}, 65);
    for (double& v : x.mutable_data<double>()) v = std::clamp(v / 4, -1.0, 1.0) * largest;
    x.mutable_data<double>()[100] = largest;
    x.mutable_data<double>()[101] = -largest;
    for (const std::int64_t k : {1, 3})
      test::judge(conv({x, random_tensor({8, 8, k, k}, 66, 0.004), random_tensor({8}, 67)},
                       ops::Conv2dParams::same(k)));
  }
}
