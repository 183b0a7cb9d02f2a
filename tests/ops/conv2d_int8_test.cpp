// Sums of products of 8-bit integers are exact at every level, however its instructions make them: with inputs and
// weights that quantisation leaves as they are, results are the integers of the definition.

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

#include "kernel_bounds.h"
#include "ops/conv2d/conv2d.h"
#include "ops/conv2d/conv2d_op.h"

using namespace slide;
using test::Call;

namespace {

/// Numbers whose step is 1: from -51 to 204 (so that the zero point is 51), both ends among them.
Tensor activations(const Shape& shape, unsigned seed) {
  Tensor x(DType::kF64, shape);
  std::mt19937 generator(seed);
  const std::span<double> values = x.mutable_data<double>();
  for (double& v : values) v = static_cast<double>(generator() % 256) - 51;
  values[0] = -51;
  values[1] = 204;
  // Some neighbours as large as can be, where pairs of products are largest.
  for (std::size_t i = 2; i < values.size(); ++i)
    if (generator() % 2 == 0) values[i] = 204;
  return x;
}

/// Integers in -127...127 of about that deviation, one of each filter 127.
Tensor weights(const Shape& shape, double sigma, unsigned seed) {
  Tensor w = test::random_tensor(shape, seed, sigma);
  const std::span<double> values = w.mutable_data<double>();
  for (double& v : values) v = std::clamp(std::round(v), -127.0, 127.0);
  const std::size_t depth = values.size() / static_cast<std::size_t>(shape[0]);
  for (std::size_t at = 0; at < values.size(); at += depth) values[at] = 127;
  return w;
}

/// The share of words of four channels in which a pair of one sign has magnitudes of more than 128.
double share_of_large_pairs(const Tensor& w) {
  const std::span<const double> values = w.data<double>();
  const auto channels = static_cast<std::size_t>(w.shape()[1]);
  const auto taps = static_cast<std::size_t>(w.shape()[2] * w.shape()[3]);
  std::set<std::size_t> words;
  std::size_t count = 0;
  for (std::size_t filter = 0; filter < static_cast<std::size_t>(w.shape()[0]); ++filter)
    for (std::size_t tap = 0; tap < taps; ++tap)
      for (std::size_t c = 0; c + 1 < channels; c += 2) {
        const std::size_t at = (filter * channels + c) * taps + tap;
        if (std::fabs(values[at] + values[at + taps]) > 128) words.insert(at - c % 4 * taps);
        count += c % 4 == 0 ? 1 : 0;
      }
  return static_cast<double>(words.size()) / static_cast<double>(count);
}

/// Checks every 8-bit kernel of this CPU, and returns their levels.
std::set<Isa> check_exact(const Call& call) {
  const Tensor exact = call.reference();
  const std::span<const double> values = exact.data<double>();
  REQUIRE(std::ranges::all_of(values, [](double v) { return std::fabs(v) < 0x1p24; }));
  std::vector<Tensor> inputs;
  for (const Tensor& t : call.inputs) inputs.push_back(t.to(DType::kF32));
  std::set<Isa> levels;
  for (const Kernel* kernel : call.op->kernels()) {
    if (kernel->precision() != Precision::kInt8 || !runs_at(kernel->isa(), detected_isa())) continue;
    if (!kernel->supports(*call.op, call.input_shapes(), call.shape)) continue;
    INFO(std::string(name_of(kernel->isa())));
    for (const int threads : {1, 3}) {
      set_thread_count(threads);
      const std::vector<float> y = test::run_guarded(*kernel, call, inputs);
      CHECK(std::ranges::equal(y, values, [](float a, double b) { return static_cast<double>(a) == b; }));
    }
    set_thread_count(0);
    levels.insert(kernel->isa());
  }
  return levels;
}

struct Case {
  const char* what;
  Shape x, weight;
  ops::Conv2dParams params;
};

/// Gathered columns, columns where they lie, few filters along the rows, odd depths, rests of panels, groups.
const std::vector<Case>& cases() {
  static const std::vector<Case> all = {
      {"1x1", {1, 64, 6, 17}, {26, 64, 1, 1}, {}},
      {"1x1, an odd depth, one filter of the last panel", {1, 35, 5, 5}, {25, 35, 1, 1}, {}},
      {"3x3 along long rows", {1, 20, 5, 50}, {40, 20, 3, 3}, ops::Conv2dParams::same(3)},
      {"3x3, few filters", {2, 16, 9, 40}, {7, 16, 3, 3}, ops::Conv2dParams::same(3)},
      {"3x3, stride 2, two filters behind whole panels",
       {1, 32, 9, 13},
       {18, 32, 3, 3},
       ops::Conv2dParams::same(3, 2)},
      {"groups, which fill no panel", {1, 48, 6, 9}, {20, 12, 3, 3}, ops::Conv2dParams::same(3, 1, 1, 4)},
  };
  return all;
}

Call call_of(const Case& c, Tensor w) {
  Tensor bias(DType::kF64, {c.weight[0]});
  double next = -3;
  for (double& v : bias.mutable_data<double>()) v = next++;
  return {{activations(c.x, 1), std::move(w), bias},
          [&](const std::vector<Value>& v) { return ops::conv2d(v[0], v[1], v[2], c.params); }};
}

}  // namespace

TEST_CASE("sums of bytes are the definition's integers, however large pairs of weights are") {
  for (const Case& c : cases()) {
    INFO(c.what);
    const std::set<Isa> levels = check_exact(call_of(c, weights(c.weight, 5, 2)));
    CHECK(levels.size() >= 1);
    // Some pairs are beyond 16 bits, but in less than half of the words.
    const Tensor some = weights(c.weight, 40, 3);
    CHECK(share_of_large_pairs(some) > 0.01);
    CHECK(share_of_large_pairs(some) < 0.2);
    CHECK(check_exact(call_of(c, some)) == levels);
    const Tensor most = weights(c.weight, 200, 4);
    CHECK(share_of_large_pairs(most) > 0.5);
    CHECK(check_exact(call_of(c, most)) == levels);
  }
}

TEST_CASE("sums of bytes are exact where all weights are the largest or the smallest") {
  for (const double value : {127.0, -127.0}) {
    Tensor w(DType::kF64, {13, 32, 3, 3});
    std::ranges::fill(w.mutable_data<double>(), value);
    const Case c{"", {1, 32, 7, 20}, w.shape(), ops::Conv2dParams::same(3)};
    CHECK(check_exact(call_of(c, w)).contains(Isa::kBaseline));
  }
}
