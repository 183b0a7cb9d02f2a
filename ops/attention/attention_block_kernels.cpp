// Queries are lanes. A block of keys gives its scores, key by query; they lower what is there to the new
// maximum and become exponentials, which weigh the values' sum. Both products keep a tile of some keys, or
// channels, by two vectors of queries in registers.

#include "ops/attention/attention_block.h"
#include "ops/simd/math.h"
#include "ops/simd/partial.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::broadcast;
using simd::Float;
using simd::load;
using simd::store;
constexpr std::int64_t kWidth = simd::kWidth;
constexpr std::int64_t kLanes = 2 * kWidth;
constexpr std::int64_t kTile = kWidth == 16 ? 8 : 4;

struct Pair {
  Float low, high;
};
SLIDE_INLINE Pair load_pair(const float* p) { return {load(p), load(p + kWidth)}; }
SLIDE_INLINE void store_pair(float* p, Pair x) {
  store(p, x.low);
  store(p + kWidth, x.high);
}
SLIDE_INLINE Pair exp_of_difference(Pair a, Pair b) {
  return {simd::exp(a.low - b.low), simd::exp(a.high - b.high)};
}
SLIDE_INLINE Pair multiply_add(Pair a, Pair b, Pair c) {
  return {fma(a.low, b.low, c.low), fma(a.high, b.high, c.high)};
}

/// A tile of a product: sum over i < depth of a[i·a_step + t·tile_step] · b[i], b[i] being kLanes numbers,
/// for t < kRows.
template <std::int64_t kRows>
SLIDE_INLINE void product(const float* a, std::int64_t a_step, std::int64_t tile_step, const float* b,
                          std::int64_t depth, Pair (&sum)[kRows]) {
  for (Pair& s : sum) s = {simd::zero(), simd::zero()};
  for (std::int64_t i = 0; i < depth; ++i) {
    const Pair x = load_pair(b + i * kLanes);
#pragma GCC unroll 8
    for (std::int64_t t = 0; t < kRows; ++t) {
      const Float factor = broadcast(a[i * a_step + t * tile_step]);
      sum[t] = {fma(factor, x.low, sum[t].low), fma(factor, x.high, sum[t].high)};
    }
  }
}

template <std::int64_t kRows>
void scores(const AttentionHead& head, std::int64_t key, const float* query, float* to) {
  Pair sum[kRows];
  product<kRows>(head.key + key, head.keys, 1, query, head.depth, sum);
  for (std::int64_t t = 0; t < kRows; ++t) store_pair(to + t * kLanes, sum[t]);
}

/// output[channel] = output[channel]·lowered + the block's weighted sum.
template <std::int64_t kRows>
void add_values(const AttentionHead& head, std::int64_t channel, std::int64_t key, std::int64_t count,
                const float* weights, Pair lowered, float* output) {
  Pair sum[kRows];
  product<kRows>(head.value + channel * head.keys + key, 1, head.keys, weights, count, sum);
  for (std::int64_t t = 0; t < kRows; ++t) {
    float* to = output + (channel + t) * kLanes;
    store_pair(to, multiply_add(load_pair(to), lowered, sum[t]));
  }
}

/// What a block of queries carries from one block of keys to the next.
struct Running {
  Pair largest, total;
};

/// Makes exponentials of a block's scores. Returns what the sums so far are to be multiplied by.
Pair exponentials(float* scores, std::int64_t count, Running& running) {
  Pair largest = running.largest;
  for (std::int64_t j = 0; j < count; ++j) {
    const Pair s = load_pair(scores + j * kLanes);
    largest = {simd::max(largest.low, s.low), simd::max(largest.high, s.high)};
  }
  const Pair lowered = exp_of_difference(running.largest, largest);
  Pair total{simd::zero(), simd::zero()};
  for (std::int64_t j = 0; j < count; ++j) {
    const Pair p = exp_of_difference(load_pair(scores + j * kLanes), largest);
    store_pair(scores + j * kLanes, p);
    total = {total.low + p.low, total.high + p.high};
  }
  running = {largest, multiply_add(running.total, lowered, total)};
  return lowered;
}

void block_of_keys(const AttentionHead& head, std::int64_t key, std::int64_t count, const float* query,
                   float* weights, float* output, Running& running) {
  std::int64_t j = 0;
  for (; j + kTile <= count; j += kTile) scores<kTile>(head, key + j, query, weights + j * kLanes);
  for (; j < count; ++j) scores<1>(head, key + j, query, weights + j * kLanes);
  const Pair lowered = exponentials(weights, count, running);
  std::int64_t c = 0;
  for (; c + kTile <= head.value_depth; c += kTile)
    add_values<kTile>(head, c, key, count, weights, lowered, output);
  for (; c < head.value_depth; ++c) add_values<1>(head, c, key, count, weights, lowered, output);
}

void block(const AttentionHead& head, std::int64_t count, float* scratch) {
  float* query = scratch;
  float* output = query + head.depth * kLanes;
  float* weights = output + head.value_depth * kLanes;
  const auto some = [&](const float* x, std::int64_t first) {
    return first < count ? simd::load_some(x + first, count - first) : simd::zero();
  };
  const Float scale = broadcast(head.scale);
  for (std::int64_t c = 0; c < head.depth; ++c) {
    const float* x = head.query + c * head.queries;
    store_pair(query + c * kLanes, {some(x, 0) * scale, some(x, kWidth) * scale});
  }
  for (std::int64_t i = 0; i < head.value_depth * kLanes; ++i) output[i] = 0;
  const Float none = broadcast(-__builtin_inff());
  Running running{{none, none}, {simd::zero(), simd::zero()}};
  constexpr std::int64_t kKeys = AttentionBlockRoutines::kKeys;
  for (std::int64_t key = 0; key < head.keys; key += kKeys)
    block_of_keys(head, key, head.keys - key < kKeys ? head.keys - key : kKeys, query, weights, output,
                  running);
  for (std::int64_t c = 0; c < head.value_depth; ++c) {
    const Pair sum = load_pair(output + c * kLanes);
    float* y = head.output + c * head.queries;
    simd::store_some(y, sum.low / running.total.low, count);
    if (count > kWidth) simd::store_some(y + kWidth, sum.high / running.total.high, count - kWidth);
  }
}

}  // namespace

extern const AttentionBlockRoutines attention_block;
const AttentionBlockRoutines attention_block{Isa::SLIDE_ISA_ENUM, kLanes, block};

}  // namespace slide::ops::SLIDE_ISA
