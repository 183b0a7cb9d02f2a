// The products by tiles: their kernels where the processor has tiles (conv2d_test.cpp runs those among all
// others), and everywhere the same source over tiles in plain code.

#include <doctest/doctest.h>

#include <algorithm>
#include <cstring>
#include <limits>

#include "kernel_bounds.h"
#include "ops/conv2d/conv2d.h"
#include "ops/conv2d/conv2d_op.h"
#include "ops/conv2d/direct/direct.h"

namespace slide::ops::emulated_tiles {
extern const Conv2dRoutines conv2d_routines;
}

using namespace slide;
using test::Call;
using test::random_tensor;

namespace {

constexpr const ops::Conv2dRoutines& kEmulated = ops::emulated_tiles::conv2d_routines;

/// The processor's, or null.
const ops::Conv2dRoutines* tiles_of_processor() {
  const std::vector<Isa> levels = available_isas();
  const auto all = ops::conv2d_routines();
  const auto found = std::ranges::find_if(all, [&](const ops::Conv2dRoutines* routines) {
    return routines->tile_depth > 1 && std::ranges::find(levels, routines->isa) != levels.end();
  });
  return found == all.end() ? nullptr : *found;
}

struct Case {
  const char* what;
  Shape x, weight;
  ops::Conv2dParams params;
};

/// Depths and filters that fill tiles and that do not, one to three tiles of columns, and all ways in which
/// columns are gathered.
const std::vector<Case>& cases() {
  static const std::vector<Case> all = {
      {"whole tiles", {1, 64, 6, 16}, {32, 64, 1, 1}, {}},
      {"a depth of three words, five filters", {1, 5, 3, 5}, {5, 5, 1, 1}, {}},
      {"two blocks of the depth, the last cut", {1, 150, 5, 7}, {17, 150, 1, 1}, {}},
      {"3x3, two images", {2, 20, 9, 13}, {24, 20, 3, 3}, ops::Conv2dParams::same(3)},
      {"many blocks", {1, 96, 5, 11}, {16, 96, 3, 3}, ops::Conv2dParams::same(3)},
      {"stride 2", {1, 18, 11, 21}, {33, 18, 3, 3}, ops::Conv2dParams::same(3, 2)},
      {"dilation 3", {1, 12, 10, 12}, {16, 12, 3, 3}, ops::Conv2dParams::same(3, 1, 3)},
      {"groups", {1, 48, 6, 9}, {40, 12, 3, 3}, ops::Conv2dParams::same(3, 1, 1, 4)},
      {"wide rows", {1, 10, 4, 130}, {9, 10, 3, 3}, ops::Conv2dParams::same(3)},
  };
  return all;
}

Call call_of(const Case& c, unsigned seed) {
  return {
      {random_tensor(c.x, seed), random_tensor(c.weight, seed + 1), random_tensor({c.weight[0]}, seed + 2)},
      [&](const std::vector<Value>& v) { return ops::conv2d(v[0], v[1], v[2], c.params); }};
}

/// The convolution by a method of words; its memory is NaN before.
template <typename Method>
std::vector<float> result(const ops::Conv2dRoutines& routines, const Call& call, int threads) {
  const auto& op = dynamic_cast<const ops::Conv2dOp&>(*call.op);
  std::vector<Tensor> inputs;
  for (const Tensor& t : call.inputs) inputs.push_back(t.to(DType::kF32));
  const auto data = [&](std::size_t i) { return inputs[i].data<float>().data(); };
  set_thread_count(threads);
  const Method method(routines, op.geometry(call.input_shapes()), op.fusion());
  std::vector<float> y(static_cast<std::size_t>(call.shape.count()), std::numeric_limits<float>::quiet_NaN());
  const auto bytes = [](std::size_t count) {
    Tensor memory(DType::kU8, Shape{static_cast<std::int64_t>(count)});
    std::memset(memory.mutable_raw().data(), 0xFF, count);
    return memory;
  };
  Tensor packed = bytes(method.packed_bytes()), scratch = bytes(method.scratch_bytes());
  method.pack(data(1), packed.mutable_raw().data());
  method.run({data(0), packed.raw().data(), data(2), nullptr, y.data()}, scratch.mutable_raw());
  set_thread_count(0);
  return y;
}

template <typename Method>
double factor(const Call& call) {
  const auto& op = dynamic_cast<const ops::Conv2dOp&>(*call.op);
  return Method(kEmulated, op.geometry(call.input_shapes()), op.fusion()).error_factor();
}

}  // namespace

TEST_CASE("products by tiles of bfloat16 are within the bound of all products of bfloat16") {
  for (const Case& c : cases()) {
    INFO(c.what);
    const Call call = call_of(c, 1);
    const Tensor exact = call.reference();
    const std::vector<float> y = result<ops::Conv2dDirectBf16>(kEmulated, call, 1);
    const double worst = test::error_in_bounds(y, exact, call.error_scale(exact),
                                               factor<ops::Conv2dDirectBf16>(call) * 0x1p-8);
    CHECK(worst <= 1);
    CHECK(worst > 1e-3);
    CHECK(y == result<ops::Conv2dDirectBf16>(kEmulated, call, 3));
  }
}

TEST_CASE("sums of bytes by tiles are exact: all bits are those that vectors give") {
  const ops::Conv2dRoutines& vectors = *ops::conv2d_routines().back();
  REQUIRE(vectors.isa == kEmulated.isa);  // what comes before and behind the sums rounds alike
  for (const Case& c : cases()) {
    INFO(c.what);
    const Call call = call_of(c, 4);
    const std::vector<float> y = result<ops::Conv2dDirectInt8>(kEmulated, call, 1);
    CHECK(y == result<ops::Conv2dDirectInt8>(vectors, call, 1));
    CHECK(y == result<ops::Conv2dDirectInt8>(kEmulated, call, 3));
  }
}

TEST_CASE("the processor's tiles and those in plain code give the same bits") {
  const ops::Conv2dRoutines* tiles = tiles_of_processor();
  if (tiles == nullptr) return;  // nothing to compare with on this processor
  for (const Case& c : cases()) {
    INFO(c.what);
    const Call call = call_of(c, 7);
    CHECK(result<ops::Conv2dDirectBf16>(*tiles, call, 2) ==
          result<ops::Conv2dDirectBf16>(kEmulated, call, 2));
  }
}

TEST_CASE("denormal operands and sums by tiles are zeros") {
  // Products of 2^-130 and 1, and of 2^-70 and 2^-70: the first are of denormals, the others make one.
  for (const int exponent : {-130, -70}) {
    Tensor x(DType::kF64, {1, 32, 2, 3}), w(DType::kF64, {16, 32, 1, 1}), b(DType::kF64, {16});
    std::ranges::fill(x.mutable_data<double>(), std::ldexp(1.0, exponent));
    std::ranges::fill(w.mutable_data<double>(), exponent == -130 ? 1.0 : std::ldexp(1.0, exponent));
    std::ranges::fill(b.mutable_data<double>(), 0.0);
    const Call call({x, w, b},
                    [&](const std::vector<Value>& v) { return ops::conv2d(v[0], v[1], v[2], {}); });
    const std::vector<float> zeros(16 * 6, 0.0F);
    CHECK(result<ops::Conv2dDirectBf16>(kEmulated, call, 1) == zeros);
    if (const ops::Conv2dRoutines* tiles = tiles_of_processor())
      CHECK(result<ops::Conv2dDirectBf16>(*tiles, call, 1) == zeros);
  }
}
