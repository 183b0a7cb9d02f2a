#pragma once

// The products of words, for sources compiled per level: what a word holds, and how it is multiplied. For
// each word of b, kRows broadcast words of a; all accumulators stay in registers over a block of the depth.

#include "ops/conv2d/conv2d_routines.h"
#include "ops/simd/lanes.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::Float;
constexpr std::int64_t kWidth = simd::kWidth;

// Accumulators, the vectors of b and a broadcast fit into the registers: 32 (AVX-512, AArch64) or 16.
#if defined(__AVX512F__) || defined(__aarch64__)
constexpr int kRows = 8;
constexpr int kVectors = 3;
#elif defined(__FMA__)
constexpr int kRows = 6;
constexpr int kVectors = 2;
#else
constexpr int kRows = 4;
constexpr int kVectors = 2;
#endif
constexpr std::int64_t kColumns = kVectors * kWidth;

using Bits = simd::Float::Bits;

SLIDE_INLINE Bits broadcast_word(const float* word) {
  std::int32_t bits;
  __builtin_memcpy(&bits, word, sizeof bits);
  return Bits{} + bits;
}
SLIDE_INLINE Bits load_words(const float* words) {
  Bits bits;
  __builtin_memcpy(&bits, words, sizeof bits);
  return bits;
}
SLIDE_INLINE void store_words(float* to, Bits bits) { __builtin_memcpy(to, &bits, sizeof bits); }
SLIDE_INLINE Float as_float(Bits bits) { return simd::from_bits<SLIDE_ISA_WIDTH>(bits); }

/// NaN stays NaN.
SLIDE_INLINE Float cut(Float x, float low, float high) {
  return simd::min(simd::broadcast(high), simd::max(simd::broadcast(low), x));
}

/// Sums in float32.
struct FloatSums {
  using Sum = Float;
  static SLIDE_INLINE Sum load(const float* sums) { return simd::load(sums); }
  static SLIDE_INLINE Sum start(const float* word) { return simd::broadcast(*word); }
  static SLIDE_INLINE Sum zero() { return simd::zero(); }
  static SLIDE_INLINE Sum add(Sum a, Sum b) { return a + b; }
  static SLIDE_INLINE void store(float* sums, Sum sum) { simd::store(sums, sum); }
  static SLIDE_INLINE Float result(const WordProduct&, int, Sum sum) { return sum; }
};

/// One float32.
struct Fp32 : FloatSums {
  static constexpr int kLanes = 1;
  static SLIDE_INLINE Sum step(Bits a, Bits b, Sum sum) { return simd::fma(as_float(a), as_float(b), sum); }
  static SLIDE_INLINE Bits word(const WordRow&, const Float* x) { return simd::bits_of(x[0]); }
};

/// Two bfloat16: the first in the low half.
struct Bf16 : FloatSums {
  static constexpr int kLanes = 2;
  static SLIDE_INLINE Sum step(Bits a, Bits b, Sum sum) {
#if defined(__AVX512BF16__)
    __m512bh left, right;
    __builtin_memcpy(&left, &a, sizeof left);
    __builtin_memcpy(&right, &b, sizeof right);
    return {_mm512_dpbf16_ps(sum.v, left, right)};
#else
    constexpr auto kHigh = static_cast<std::int32_t>(0xFFFF0000);
    const Sum low = simd::fma(as_float(a << 16), as_float(b << 16), sum);
    return simd::fma(as_float(a & kHigh), as_float(b & kHigh), low);
#endif
  }
  /// To the nearest, ties to even, in the high half; NaN stays NaN.
  static SLIDE_INLINE Bits rounded(Float x) {
    const Bits bits = simd::bits_of(x);
    const Bits nearest = bits + 0x7FFF + (bits >> 16 & 1);
    const Bits quiet = bits | 0x00400000;
    return simd::is_nan(x).v ? quiet : nearest;
  }
  static SLIDE_INLINE Bits word(const WordRow&, const Float* x) {
    constexpr auto kHigh = static_cast<std::int32_t>(0xFFFF0000);
    return (rounded(x[0]) >> 16 & 0xFFFF) | (rounded(x[1]) & kHigh);
  }
};

/// Four integers: b unsigned, a signed; sums are int32.
struct Int8 {
  static constexpr int kLanes = 4;
  using Sum = Bits;
  static SLIDE_INLINE Sum load(const float* sums) { return load_words(sums); }
  static SLIDE_INLINE Sum start(const float* word) { return broadcast_word(word); }
  static SLIDE_INLINE Sum zero() { return Bits{}; }
  static SLIDE_INLINE Sum add(Sum a, Sum b) { return a + b; }
  static SLIDE_INLINE void store(float* sums, Sum sum) { store_words(sums, sum); }
  static SLIDE_INLINE Float result(const WordProduct& p, int row, Sum sum) {
    const Float value = {__builtin_convertvector(sum, Float::Native)};
    return simd::fma(value, simd::broadcast(p.step[row]), simd::broadcast(p.bias[row]));
  }
  static SLIDE_INLINE Sum step(Bits a, Bits b, Sum sum) {
#if defined(__AVX512VNNI__)
    __m512i left, right, total;
    __builtin_memcpy(&left, &a, sizeof left);
    __builtin_memcpy(&right, &b, sizeof right);
    __builtin_memcpy(&total, &sum, sizeof total);
    total = _mm512_dpbusd_epi32(total, right, left);
    __builtin_memcpy(&sum, &total, sizeof sum);
    return sum;
#else
    for (int lane = 0; lane < 4; ++lane) sum += (a << (24 - 8 * lane) >> 24) * (b >> 8 * lane & 0xFF);
    return sum;
#endif
  }
  static SLIDE_INLINE Bits word(const WordRow& row, const Float* x) {
    Bits word{};
    for (int lane = 0; lane < 4; ++lane) {
      // Half is added because conversion cuts off.
      const Float scaled =
          simd::fma(x[lane], simd::broadcast(row.inverse_step), simd::broadcast(row.zero + 0.5F));
      const Float inside = simd::min(simd::max(scaled, simd::zero()), simd::broadcast(255.0F));
      word |= __builtin_convertvector(inside.v, Bits) << 8 * lane;
    }
    return word;
  }
};

/// The first `count` <= kWidth words.
SLIDE_INLINE Bits load_some_words(const float* words, std::int64_t count) {
  if (count >= kWidth) return load_words(words);
  return simd::bits_of(simd::load_partial(words, static_cast<std::size_t>(count)));
}

/// `end`: how many words of a row's last vector there are. The first block starts from its words; each later
/// one is summed by itself and then added, so that blocks bound the roundings.
template <typename P, int R, int V, bool kExact>
SLIDE_INLINE void multiply_block(const WordProduct& p, std::int64_t end) {
  typename P::Sum sums[R][V];
  for (int m = 0; m < R; ++m)
    for (int v = 0; v < V; ++v) sums[m][v] = p.start != nullptr ? P::start(p.start + m) : P::zero();
  const float* a = p.a;
  for (std::int64_t k = 0; k < p.depth; ++k, a += kRows) {
    const float* row = p.b + p.offsets[k];
    const float* later = p.b + p.offsets[k + kWordsAhead];
    for (int v = 0; v <= V; ++v) __builtin_prefetch(later + v * kWidth);
    Bits right[V];
    for (int v = 0; v < V - 1; ++v) right[v] = load_words(row + v * kWidth);
    const float* tail = row + (V - 1) * kWidth;
    right[V - 1] = kExact ? load_some_words(tail, end) : load_words(tail);
    for (int m = 0; m < R; ++m) {
      const Bits left = broadcast_word(a + m);
      for (int v = 0; v < V; ++v) sums[m][v] = P::step(left, right[v], sums[m][v]);
    }
  }
  if (p.start == nullptr)
    for (int m = 0; m < R; ++m)
      for (int v = 0; v < V; ++v)
        sums[m][v] = P::add(P::load(p.sums + m * kColumns + v * kWidth), sums[m][v]);
  if (!p.last) {
    for (int m = 0; m < R; ++m)
      for (int v = 0; v < V; ++v) P::store(p.sums + m * kColumns + v * kWidth, sums[m][v]);
    return;
  }
  for (int m = 0; m < R; ++m) {
    if (m >= p.row_count) break;
    float* y = p.y + m * p.y_stride;
    for (int v = 0; v < V; ++v) {
      const Float value = cut(P::result(p, m, sums[m][v]), p.low, p.high);
      if (v < V - 1 || end >= kWidth)
        simd::store(y + v * kWidth, value);
      else
        simd::store_partial(y + v * kWidth, value, static_cast<std::size_t>(end));
    }
  }
}

template <typename P, int R, int V>
void multiply_rows_of_words(const WordProduct& p) {
  if constexpr (V > 1)
    if (p.column_count <= (V - 1) * kWidth) return multiply_rows_of_words<P, R, V - 1>(p);
  const std::int64_t end = p.column_count - (V - 1) * kWidth;
  if (p.exact && end < kWidth) return multiply_block<P, R, V, true>(p, end);
  multiply_block<P, R, V, false>(p, end);
}

template <typename P>
void multiply_words(const WordProduct& p) {
  if (p.row_count > 4) return multiply_rows_of_words<P, kRows, kVectors>(p);
  if (p.row_count > 2) return multiply_rows_of_words<P, 4, kVectors>(p);
  if (p.row_count > 1) return multiply_rows_of_words<P, 2, kVectors>(p);
  multiply_rows_of_words<P, 1, kVectors>(p);
}

/// One vector of words from x[first...first + count·stride), count <= kWidth; `more`: others follow in the
/// row.
template <typename P>
SLIDE_INLINE Bits make_words(const WordRow& row, std::int64_t first, std::int64_t stride, std::int64_t count,
                             bool more) {
  Float x[P::kLanes];
  for (int lane = 0; lane < P::kLanes; ++lane) {
    if (row.x[lane] == nullptr) {
      x[lane] = simd::zero();
    } else if (stride == 1 && count == kWidth) {
      x[lane] = simd::load(row.x[lane] + first);
    } else if (stride == 2 && more) {
      x[lane] = simd::even(simd::load(row.x[lane] + first), simd::load(row.x[lane] + first + kWidth));
    } else {
      float gathered[kWidth] = {};
      for (std::int64_t j = 0; j < count; ++j) gathered[j] = row.x[lane][first + j * stride];
      x[lane] = simd::load(gathered);
    }
    if (row.relu) x[lane] = simd::max(simd::zero(), x[lane]);
  }
  return P::word(row, x);
}

template <typename P>
void fill_row(const WordRow& row, std::int64_t width, std::int64_t start, std::int64_t stride, float outside,
              float* y, std::int64_t count) {
  std::int64_t first = start >= 0 ? 0 : (-start + stride - 1) / stride;
  if (first > count) first = count;
  std::int64_t last = start >= width ? 0 : (width - 1 - start) / stride + 1;
  if (width == 0 || last < first) last = first;
  if (last > count) last = count;
  for (std::int64_t j = 0; j < first; ++j) __builtin_memcpy(y + j, &outside, sizeof outside);
  std::int64_t j = first;
  for (; j + kWidth <= last; j += kWidth)
    store_words(y + j, make_words<P>(row, start + j * stride, stride, kWidth, j + kWidth < last));
  if (j < last) {
    const Bits words = make_words<P>(row, start + j * stride, stride, last - j, false);
    __builtin_memcpy(y + j, &words, static_cast<std::size_t>(last - j) * sizeof(float));
  }
  for (j = last; j < count; ++j) __builtin_memcpy(y + j, &outside, sizeof outside);
}

void range(const float* x, std::int64_t count, float* low, float* high) {
  Float least = simd::zero();
  Float most = simd::zero();
  std::int64_t i = 0;
  for (; i + kWidth <= count; i += kWidth) {
    const Float v = simd::load(x + i);
    least = simd::min(v, least);
    most = simd::max(v, most);
  }
  if (i < count) {
    const Float v = simd::load_partial(x + i, static_cast<std::size_t>(count - i));
    least = simd::min(v, least);
    most = simd::max(v, most);
  }
  *high = simd::max_of_lanes(most);
  *low = -simd::max_of_lanes(-least);
}

}  // namespace
}  // namespace slide::ops::SLIDE_ISA
