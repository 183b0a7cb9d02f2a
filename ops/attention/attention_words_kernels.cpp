// Queries are columns. Scores are keys by queries, and their exponentials, two keys to a word, the right side
// of the second product. Both products are made in tiles of 32 rows by 32 columns: four of AMX's, or rows of
// vectors.

#include "ops/attention/attention_words.h"
#include "ops/conv2d/words.h"
#include "ops/simd/lanes.h"
#include "ops/simd/partial.h"
#if defined(SLIDE_TILES)
#include "ops/conv2d/tiles.h"
#endif

namespace slide::ops::SLIDE_ISA {
namespace {

using Routines = AttentionWordsRoutines;
using simd::broadcast;
using simd::load;
using simd::store;
constexpr std::int64_t kWidth = simd::kWidth;
constexpr std::int64_t kQueries = Routines::kQueries;

void pack_keys(const float* key, std::int64_t depth, std::int64_t keys, std::int64_t first, float* words) {
  const std::int64_t row = Routines::key_words(depth);
  const auto channel = [&](std::int64_t c, std::int64_t j) {
    return c < depth && j < keys ? simd::load_some(key + c * keys + j, keys - j) : simd::zero();
  };
  for (std::int64_t j = 0; j < Routines::kFilledKeys; j += kWidth)
    for (std::int64_t w = 0; w < row; ++w) {
      const Float pair[] = {channel(2 * w, first + j), channel(2 * w + 1, first + j)};
      float column[kWidth];
      store_words(column, Bf16::word(0, 0, pair));
      for (std::int64_t i = 0; i < kWidth; ++i)
        __builtin_memcpy(words + (j + i) * row + w, column + i, sizeof(float));
    }
}

void pack_values(const float* value, std::int64_t keys, float* words) {
  const auto some = [&](std::int64_t j) {
    return j < keys ? simd::load_some(value + j, keys - j) : simd::zero();
  };
  for (std::int64_t w = 0; w < Routines::value_words(keys); w += kWidth) {
    const Float low = some(2 * w);
    const Float high = some(2 * w + kWidth);
    const Float pair[] = {simd::even(low, high), simd::odd(low, high)};
    store_words(words + w, Bf16::word(0, 0, pair));
  }
}

/// c = a · b, or with kAdds c + a · b: rows of `depth` words, a_step apart, by rows of kQueries words.
#if defined(SLIDE_TILES)
template <bool kAdds>
void product(const float* a, std::int64_t a_step, const float* b, std::int64_t depth, std::int64_t rows,
             float* c) {
  static_assert(kQueries == 2 * kTileWords && Routines::kRows == 2 * kTileHeight);
  static_assert(Routines::kDepth == 2 * kTileWords && Routines::kFilledKeys == 2 * kTileWords);
  Tiles tiles;
  for (std::int64_t m = 0; m < rows; m += 2 * kTileHeight, a += 2 * kTileHeight * a_step) {
    float* upper = c + m * kQueries;
    float* lower = upper + kTileHeight * kQueries;
    if (kAdds) {
      tiles.load<0>(upper, kQueries);
      tiles.load<1>(upper + kTileWords, kQueries);
      tiles.load<2>(lower, kQueries);
      tiles.load<3>(lower + kTileWords, kQueries);
    } else {
      tiles.zero<0>();
      tiles.zero<1>();
      tiles.zero<2>();
      tiles.zero<3>();
    }
    for (std::int64_t k = 0; k < depth; k += kTileWords) {
      tiles.load<4>(a + k, a_step);
      tiles.load<6>(b + k * kQueries, kQueries);
      tiles.load<7>(b + k * kQueries + kTileWords, kQueries);
      tiles.add_bf16<0, 4, 6>();
      tiles.add_bf16<1, 4, 7>();
      tiles.load<5>(a + kTileHeight * a_step + k, a_step);
      tiles.add_bf16<2, 5, 6>();
      tiles.add_bf16<3, 5, 7>();
    }
    tiles.store<0>(upper, kQueries);
    tiles.store<1>(upper + kTileWords, kQueries);
    tiles.store<2>(lower, kQueries);
    tiles.store<3>(lower + kTileWords, kQueries);
  }
}
#else
template <bool kAdds>
void product(const float* a, std::int64_t a_step, const float* b, std::int64_t depth, std::int64_t rows,
             float* c) {
  constexpr int kBlock = 8;
  constexpr int kVectors = kQueries / kWidth;
  static_assert(Routines::kRows % kBlock == 0);
  for (std::int64_t m = 0; m < rows; m += kBlock, a += kBlock * a_step, c += kBlock * kQueries) {
    Float sums[kBlock][kVectors];
#pragma GCC unroll 8
    for (int i = 0; i < kBlock; ++i)
#pragma GCC unroll 8
      for (int v = 0; v < kVectors; ++v)
        sums[i][v] = kAdds ? load(c + i * kQueries + v * kWidth) : simd::zero();
    for (std::int64_t k = 0; k < depth; ++k) {
      Bits right[kVectors];
#pragma GCC unroll 8
      for (int v = 0; v < kVectors; ++v) right[v] = load_words(b + k * kQueries + v * kWidth);
#pragma GCC unroll 8
      for (int i = 0; i < kBlock; ++i) {
        const Bits left = broadcast_word(a + i * a_step + k);
#pragma GCC unroll 8
        for (int v = 0; v < kVectors; ++v) sums[i][v] = Bf16::step(left, right[v], sums[i][v]);
      }
    }
#pragma GCC unroll 8
    for (int i = 0; i < kBlock; ++i)
#pragma GCC unroll 8
      for (int v = 0; v < kVectors; ++v) store(c + i * kQueries + v * kWidth, sums[i][v]);
  }
}
#endif

/// 2^x for x <= 0, 0 below 2^-126; NaN stays NaN. 2^r on [-1/2, 1/2] is a minimax polynomial for the relative
/// error, 2^-18, which is 1 at 0: what is there stays as it is where the largest score does.
SLIDE_INLINE Float power_of_two(Float x) {
  const Float magic = broadcast(0x1.8p23F);
  x = simd::max(broadcast(-127.0F), x);
  const Float k = (x + magic) - magic;
  const Float r = x - k;
  Float p = broadcast(0x1.409104p-7F);
  p = fma(p, r, broadcast(0x1.ca9008p-5F));
  p = fma(p, r, broadcast(0x1.ebf1b4p-3F));
  p = fma(p, r, broadcast(0x1.62dfcap-1F));
  p = fma(p, r, broadcast(1.0F));
  const Bits biased = simd::bits_of(k + broadcast(0x1.8p23F + 127.0F));
  return p * as_float(biased << 23);
}

/// To the nearest bfloat16, ties away from zero: of numbers that cannot overflow. NaN whose low half is zero
/// stays NaN, and that of products of words has no other.
SLIDE_INLINE Bits rounded_weight(Float p) {
  return (simd::bits_of(p) + 0x8000) & static_cast<std::int32_t>(0xFFFF0000);
}

/// What a block of queries carries from one block of keys to the next.
struct Running {
  float largest[kQueries], total[kQueries];
};

/// Makes words of weights of `count` keys' scores, which are exponents of 2, and zeros for the others up to
/// kFilledKeys; lowers the results so far to the new largest score.
void weigh(const float* scores, std::int64_t count, Running& running, float* weights, float* output,
           std::int64_t output_rows) {
  const std::int64_t filled = Routines::filled(count, Routines::kFilledKeys);
  for (std::int64_t v = 0; v < kQueries; v += kWidth) {
    const Float before = load(running.largest + v);
    Float largest = before;
    for (std::int64_t j = 0; j < count; ++j) largest = simd::max(largest, load(scores + j * kQueries + v));
    const Float lowered = power_of_two(before - largest);
    Float total = load(running.total + v) * lowered;
    const auto weight = [&](std::int64_t j) {
      if (j >= count) return Bits{};
      return rounded_weight(power_of_two(load(scores + j * kQueries + v) - largest));
    };
    for (std::int64_t j = 0; j < filled; j += 2) {
      const Bits low = weight(j);
      const Bits high = weight(j + 1);
      total = total + (as_float(low) + as_float(high));
      store_words(weights + j / 2 * kQueries + v, (low >> 16 & 0xFFFF) | high);
    }
    store(running.largest + v, largest);
    store(running.total + v, total);
    for (std::int64_t c = 0; c < output_rows; ++c) {
      float* y = output + c * kQueries + v;
      store(y, load(y) * lowered);
    }
  }
}

/// The queries' words, scaled so that scores are exponents of 2; zeros behind the last query and channel.
void pack_queries(const AttentionWords& head, std::int64_t count, float* words) {
  constexpr float kLog2E = 0x1.715476p0F;
  const Float scale = broadcast(head.scale * kLog2E);
  const auto channel = [&](std::int64_t c, std::int64_t v) {
    return c < head.depth && v < count ? simd::load_some(head.query + c * head.queries + v, count - v) * scale
                                       : simd::zero();
  };
  for (std::int64_t w = 0; w < Routines::key_words(head.depth); ++w)
    for (std::int64_t v = 0; v < kQueries; v += kWidth) {
      const Float pair[] = {channel(2 * w, v), channel(2 * w + 1, v)};
      store_words(words + w * kQueries + v, Bf16::word(0, 0, pair));
    }
}

void block(const AttentionWords& head, std::int64_t count, float* scratch) {
  const std::int64_t key_words = Routines::key_words(head.depth);
  const std::int64_t rows = Routines::value_rows(head.value_depth);
  float* query = scratch;
  float* output = query + key_words * kQueries;
  float* weights = output + rows * kQueries;
  float* scores = weights + Routines::kKeys / 2 * kQueries;
#if defined(SLIDE_TILES)
  Tiles::configure();
#endif
  pack_queries(head, count, query);
  for (std::int64_t i = 0; i < rows * kQueries; ++i) output[i] = 0;
  Running running;
  for (std::int64_t i = 0; i < kQueries; ++i) {
    running.largest[i] = -__builtin_inff();
    running.total[i] = 0;
  }
  for (std::int64_t key = 0; key < head.keys; key += Routines::kKeys) {
    const std::int64_t keys = head.keys - key < Routines::kKeys ? head.keys - key : Routines::kKeys;
    const std::int64_t filled = Routines::filled(keys, Routines::kFilledKeys);
    product<false>(head.key_words + key * key_words, key_words, query, key_words, filled, scores);
    weigh(scores, keys, running, weights, output, rows);
    product<true>(head.value_words + key / 2, Routines::value_words(head.keys), weights, filled / 2, rows,
                  output);
  }
#if defined(SLIDE_TILES)
  Tiles::release();
#endif
  for (std::int64_t c = 0; c < head.value_depth; ++c)
    for (std::int64_t v = 0; v < count; v += kWidth)
      simd::store_some(head.output + c * head.queries + v,
                       load(output + c * kQueries + v) / load(running.total + v), count - v);
}

}  // namespace

extern const AttentionWordsRoutines attention_words;
const AttentionWordsRoutines attention_words{Isa::SLIDE_ISA_ENUM, pack_keys, pack_values, block};

}  // namespace slide::ops::SLIDE_ISA
