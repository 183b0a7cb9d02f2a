#pragma once

// The products of words, for sources compiled per level. For each word of b, kRows broadcast words of a; all
// accumulators stay in registers over a block of the depth.

#include "ops/conv2d/words.h"
#include "ops/simd/lanes.h"
#include "ops/simd/partial.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::load_some;
using simd::store_some;
constexpr std::int64_t kWidth = simd::kWidth;

// Accumulators, the vectors of b and a broadcast fit into the registers: 32 (AVX-512, AArch64) or 16.
#if defined(SLIDE_TILES_EMULATED)
constexpr int kRows = 4;
constexpr int kVectors = 48 / kWidth;
#elif defined(__AVX512F__) || defined(__aarch64__)
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

/// NaN stays NaN.
SLIDE_INLINE Float cut(Float x, float low, float high) {
  return simd::min(simd::broadcast(high), simd::max(simd::broadcast(low), x));
}

// Loops over accumulators are unrolled whole: an array that is indexed by a variable lies in memory.
#define SLIDE_UNROLLED _Pragma("GCC unroll 8")

/// `end`: how many words of the last vector there are.
template <int V>
SLIDE_INLINE void add_residual(const float* residual, Float (&values)[V], std::int64_t end) {
  SLIDE_UNROLLED for (int v = 0; v < V - 1; ++v) values[v] = values[v] + simd::load(residual + v * kWidth);
  values[V - 1] = values[V - 1] + load_some(residual + (V - 1) * kWidth, end);
}

/// What the last block does with finished sums; `end`: how many words of a row's last vector there are.
template <typename P, int R, int V>
SLIDE_INLINE void write_sums(const WordProduct& p, const typename P::Sum (&sums)[R][V], std::int64_t end) {
  const Float low = simd::broadcast(p.low);
  const Float high = simd::broadcast(p.high);
  SLIDE_UNROLLED for (int m = 0; m < R; ++m) {
    if (m < p.row_count) {
      float* y = p.y + m * p.y_stride;
      Float values[V];
      SLIDE_UNROLLED for (int v = 0; v < V; ++v) values[v] = P::result(p, m, sums[m][v]);
      const bool added = p.residual != nullptr;
      if (added && !p.residual_last) add_residual(p.residual + m * p.y_stride, values, end);
      SLIDE_UNROLLED for (int v = 0; v < V; ++v) values[v] = simd::min(high, simd::max(low, values[v]));
      if (added && p.residual_last) add_residual(p.residual + m * p.y_stride, values, end);
      SLIDE_UNROLLED for (int v = 0; v < V - 1; ++v) simd::store(y + v * kWidth, values[v]);
      store_some(y + (V - 1) * kWidth, values[V - 1], end);
    }
  }
}

/// What the last block will read or write behind its sums comes closer while they are made.
template <int R, int V>
SLIDE_INLINE void prefetch_rows(const WordProduct& p) {
  SLIDE_UNROLLED for (int m = 0; m < R; ++m) {
    SLIDE_UNROLLED for (int v = 0; v < V; ++v) {
      if (p.residual != nullptr)
        __builtin_prefetch(p.residual + m * p.y_stride + v * kWidth);
      else
        __builtin_prefetch(p.y + m * p.y_stride + v * kWidth, 1);
    }
  }
}

/// Row k of b.
template <bool kOffsets>
SLIDE_INLINE const float* row_of(const WordProduct& p, std::int64_t k) {
  return p.b + (kOffsets ? p.offsets[k] : k * kColumns);
}

template <typename P, int R, int V, bool kOffsets>
SLIDE_INLINE void sum_words(const WordProduct& p, const float* start, typename P::Sum (&sums)[R][V]) {
  SLIDE_UNROLLED for (int m = 0; m < R; ++m) {
    SLIDE_UNROLLED for (int v = 0; v < V; ++v) sums[m][v] = P::start(start + m);
  }
  const float* a = p.a;
  const float* b = p.b;
  for (std::int64_t k = 0; k < p.depth; ++k, a += kRows, b += kOffsets ? 0 : kColumns) {
    const float* row = kOffsets ? b + p.offsets[k] : b;
    if (R == kRows) __builtin_prefetch(a + p.depth * kRows);  // what the next panel reads
    Bits right[V];
    SLIDE_UNROLLED for (int v = 0; v < V; ++v) right[v] = load_words(row + v * kWidth);
    SLIDE_UNROLLED for (int m = 0; m < R; ++m) {
      const Bits left = broadcast_word(a + m);
      SLIDE_UNROLLED for (int v = 0; v < V; ++v) sums[m][v] = P::step(left, right[v], sums[m][v]);
    }
  }
}

/// What was split off the words of a, row by row.
template <typename P, int R, int V, bool kOffsets>
SLIDE_INLINE void add_rests(const WordProduct& p, typename P::Sum (&sums)[R][V]) {
  const std::int32_t* entry = p.rests + kRows;
  SLIDE_UNROLLED for (int m = 0; m < R; ++m) {
    for (const std::int32_t* end = p.rests + kRows + 2 * p.rests[m]; entry != end; entry += 2) {
      const float* row = row_of<kOffsets>(p, entry[0]);
      const Bits left = Bits{} + entry[1];
      SLIDE_UNROLLED for (int v = 0; v < V; ++v) sums[m][v] =
          P::step(left, load_words(row + v * kWidth), sums[m][v]);
    }
  }
}

#if defined(__ARM_FEATURE_MATMUL_INT8)
/// Two rows of a by two columns of b are a square: column 0's sums for both rows, column 1's. An instruction adds the
/// products of two words of the depth.
template <typename P, int R, int V>
SLIDE_INLINE void add_squares(const float* const (&a)[2], const float* const (&b)[2],
                              Bits (&squares)[R / 2][2 * V]) {
  Bits rows[(R + 3) / 4 * 2];
  SLIDE_UNROLLED for (int i = 0; i < (R + 3) / 4; ++i) {
    const Bits low = load_words(a[0] + 4 * i), high = load_words(a[1] + 4 * i);
    rows[2 * i] = vzip1q_s32(low, high);
    rows[2 * i + 1] = vzip2q_s32(low, high);
  }
  SLIDE_UNROLLED for (int v = 0; v < V; ++v) {
    const Bits low = load_words(b[0] + v * kWidth), high = load_words(b[1] + v * kWidth);
    const Bits columns[2] = {vzip1q_s32(low, high), vzip2q_s32(low, high)};
    SLIDE_UNROLLED for (int i = 0; i < R / 2; ++i) {
      SLIDE_UNROLLED for (int j = 0; j < 2; ++j) squares[i][2 * v + j] =
          P::square(columns[j], rows[i], squares[i][2 * v + j]);
    }
  }
}

template <typename P, int R, int V, bool kOffsets>
SLIDE_INLINE void sum_squares(const WordProduct& p, const float* start, typename P::Sum (&sums)[R][V]) {
  static constexpr float kZeros[kColumns > kRows ? kColumns : kRows] = {};
  Bits squares[R / 2][2 * V];
  SLIDE_UNROLLED for (int i = 0; i < R / 2; ++i) {
    std::int32_t two[2];
    __builtin_memcpy(two, start + 2 * i, sizeof two);
    SLIDE_UNROLLED for (int j = 0; j < 2 * V; ++j) squares[i][j] = Bits{two[0], two[1], two[0], two[1]};
  }
  const float* a = p.a;
  std::int64_t k = 0;
  for (; k + 1 < p.depth; k += 2, a += 2 * kRows)
    add_squares<P, R, V>({a, a + kRows}, {row_of<kOffsets>(p, k), row_of<kOffsets>(p, k + 1)}, squares);
  if (k < p.depth) add_squares<P, R, V>({a, kZeros}, {row_of<kOffsets>(p, k), kZeros}, squares);
  SLIDE_UNROLLED for (int i = 0; i < R / 2; ++i) {
    SLIDE_UNROLLED for (int v = 0; v < V; ++v) {
      sums[2 * i][v] = P::of_bits(vuzp1q_s32(squares[i][2 * v], squares[i][2 * v + 1]));
      sums[2 * i + 1][v] = P::of_bits(vuzp2q_s32(squares[i][2 * v], squares[i][2 * v + 1]));
    }
  }
}
#endif

/// The first block starts from its words; each later one is summed by itself and then added, so that blocks
/// bound the roundings.
template <typename P, int R, int V, bool kOffsets>
SLIDE_INLINE void multiply_block(const WordProduct& p, std::int64_t end) {
  static constexpr float kZeros[R] = {};
  const float* start = p.first ? p.start : kZeros;
  typename P::Sum sums[R][V];
  if (p.last) prefetch_rows<R, V>(p);
#if defined(__ARM_FEATURE_MATMUL_INT8)
  if constexpr (P::kSquares)
    sum_squares<P, R, V, kOffsets>(p, start, sums);
  else
#endif
    sum_words<P, R, V, kOffsets>(p, start, sums);
  if constexpr (P::kSplitsPairs) add_rests<P, R, V, kOffsets>(p, sums);
  if (!p.first) {
    SLIDE_UNROLLED for (int m = 0; m < R; ++m) {
      SLIDE_UNROLLED for (int v = 0; v < V; ++v) sums[m][v] =
          P::add(P::load(p.sums + m * kColumns + v * kWidth), sums[m][v]);
    }
  }
  if (p.last) return write_sums<P>(p, sums, end);
  SLIDE_UNROLLED for (int m = 0; m < R; ++m) {
    SLIDE_UNROLLED for (int v = 0; v < V; ++v) P::store(p.sums + m * kColumns + v * kWidth, sums[m][v]);
  }
}

template <typename P, int R, int V>
void multiply_rows_of_words(const WordProduct& p) {
  if constexpr (V > 1)
    if (p.column_count <= (V - 1) * kWidth) return multiply_rows_of_words<P, R, V - 1>(p);
  const std::int64_t end = p.column_count - (V - 1) * kWidth;
  if (p.offsets != nullptr) return multiply_block<P, R, V, true>(p, end);
  multiply_block<P, R, V, false>(p, end);
}

template <typename P>
void multiply_words(const WordProduct& p) {
  if constexpr (P::kSplitsPairs)
    if (p.rests[0] < 0) return multiply_words<Int8Wide>(p);
  for (std::int64_t j = 0; j < p.ahead_count; j += kRowAlignment) __builtin_prefetch(p.ahead + j, 0, 2);
  if (p.row_count > 4) return multiply_rows_of_words<P, kRows, kVectors>(p);
  if (p.row_count > 2) return multiply_rows_of_words<P, 4, kVectors>(p);
  if (p.row_count > 1 || P::kSquares) return multiply_rows_of_words<P, 2, kVectors>(p);
  multiply_rows_of_words<P, P::kSquares ? 2 : 1, kVectors>(p);
}

/// x[0], x[stride], ...: `count` <= kWidth of them, zeros in the other lanes. `more`: others follow.
SLIDE_INLINE Float load_every(const float* x, std::int64_t stride, std::int64_t count, bool more) {
  if (stride == 1) return load_some(x, count);
  if (stride == 2) {
    if (more) return simd::even(simd::load(x), simd::load(x + kWidth));
    const std::int64_t rest = 2 * count - 1 - kWidth;
    return simd::even(load_some(x, rest + kWidth), rest > 0 ? load_some(x + kWidth, rest) : simd::zero());
  }
  float gathered[kWidth] = {};
  for (std::int64_t j = 0; j < count; ++j) gathered[j] = x[j * stride];
  return simd::load(gathered);
}

/// One vector of words of the first `lanes` channels at x.
template <typename P>
SLIDE_INLINE Bits make_words(const WordSource& s, const float* x, std::int64_t lanes, std::int64_t stride,
                             std::int64_t count, bool more) {
  Float lane[P::kLanes];
  for (int l = 0; l < P::kLanes; ++l) {
    lane[l] = l < lanes ? load_every(x + l * s.plane_size, stride, count, more) : simd::zero();
    lane[l] = simd::max(simd::broadcast(s.least), lane[l]);
  }
  return P::word(s.zero, s.inverse_step, lane);
}

/// A vector of words.
struct WordMove {
  std::int64_t from, to;
};

/// The same few vectors of each row, which overlap by rising `to`.
template <int N>
void copy_moves(const WordGather& g, const WordMove* moves, std::int64_t depth, float* b) {
  for (std::int64_t k = 0; k < depth; ++k, b += kColumns) {
    const float* x = g.source.x + g.offsets[k];
    Bits words[N];
    SLIDE_UNROLLED for (int n = 0; n < N; ++n) words[n] = load_words(x + moves[n].from);
    SLIDE_UNROLLED for (int n = 0; n < N; ++n) store_words(b + moves[n].to, words[n]);
  }
}

/// Words as they are, whole vectors of them.
void gather_copies(const WordGather& g, std::int64_t depth, float* b) {
  constexpr std::int64_t kMost = 6;
  WordMove moves[kMost];
  std::int64_t count = 0;
  for (std::int64_t r = 0; r < g.run_count; ++r)
    for (std::int64_t j = 0; j < g.runs[r].count; j += kWidth, ++count)
      if (count < kMost) moves[count] = {g.runs[r].from + j, g.runs[r].to + j};
  if (count == 2) return copy_moves<2>(g, moves, depth, b);
  if (count == 3) return copy_moves<3>(g, moves, depth, b);
  if (count == 4) return copy_moves<4>(g, moves, depth, b);
  if (count == 5) return copy_moves<5>(g, moves, depth, b);
  if (count == 6) return copy_moves<6>(g, moves, depth, b);
  for (std::int64_t k = 0; k < depth; ++k, b += kColumns) {
    const float* x = g.source.x + g.offsets[k];
    for (std::int64_t r = 0; r < g.run_count; ++r) {
      const WordRun run = g.runs[r];
      for (std::int64_t j = 0; j < run.count; j += kWidth)
        store_words(b + run.to + j, load_words(x + run.from + j));
    }
  }
}

/// A whole panel of neighbouring positions.
template <typename P>
SLIDE_INLINE void gather_whole(const WordGather& g, std::int64_t depth, float* b) {
  for (std::int64_t k = 0; k < depth; ++k, b += kColumns) {
    const float* x = g.source.x + g.offsets[k] + g.runs[0].from;
    const std::int64_t lanes = g.source.channels - k * P::kLanes;
    for (int v = 0; v < kVectors; ++v) {
      const float* at = x + v * kWidth;
      // Where all lanes are there, nothing is left to decide.
      const Bits words = lanes >= P::kLanes ? make_words<P>(g.source, at, P::kLanes, 1, kWidth, false)
                                            : make_words<P>(g.source, at, lanes, 1, kWidth, false);
      store_words(b + v * kWidth, words);
    }
  }
}

template <typename P>
void gather(const WordGather& g, std::int64_t depth, float* b) {
  if (g.run_count == 1 && g.runs[0].count == kColumns && g.stride == 1) return gather_whole<P>(g, depth, b);
  for (std::int64_t k = 0; k < depth; ++k, b += kColumns) {
    const float* x = g.source.x + g.offsets[k];
    const std::int64_t lanes = g.source.channels - k * P::kLanes;
    for (std::int64_t r = 0; r < g.run_count; ++r) {
      const WordRun& run = g.runs[r];
      for (std::int64_t j = 0; j < run.count; j += kWidth) {
        const std::int64_t rest = run.count - j;
        const Bits words = make_words<P>(g.source, x + run.from + j * g.stride, lanes, g.stride,
                                         rest < kWidth ? rest : kWidth, rest > kWidth);
        store_words(b + run.to + j, words);
      }
    }
  }
}

/// `count` words from x[0], x[stride], ... A stride of 1 or 2 and all lanes are known when this is compiled.
template <typename P, int kStride, bool kAllLanes>
SLIDE_INLINE void fill_inside(const WordSource& s, const float* x, std::int64_t stride, float* y,
                              std::int64_t count) {
  const std::int64_t step = kStride > 0 ? kStride : stride;
  const std::int64_t lanes = kAllLanes ? P::kLanes : s.channels;
  std::int64_t j = 0;
  for (; j + kWidth < count; j += kWidth)
    store_words(y + j, make_words<P>(s, x + j * step, lanes, step, kWidth, true));
  if (j < count) {
    const Bits words = make_words<P>(s, x + j * step, lanes, step, count - j, false);
    store_some(y + j, as_float(words), count - j);
  }
}

template <typename P, int kStride, bool kAllLanes>
void fill_rows_inside(const WordSource& s, const float* x, const WordRows& r, float* y, std::int64_t first,
                      std::int64_t last) {
  for (std::int64_t row = 0; row < r.rows; ++row, x += r.x_step, y += r.y_step) {
    for (std::int64_t j = 0; j < first; ++j) __builtin_memcpy(y + j, &r.outside, sizeof r.outside);
    fill_inside<P, kStride, kAllLanes>(s, x, r.stride, y + first, last - first);
    for (std::int64_t j = last; j < r.count; ++j) __builtin_memcpy(y + j, &r.outside, sizeof r.outside);
  }
}

template <typename P>
void fill_rows(const WordSource& s, const WordRows& r, float* y) {
  std::int64_t first = r.start >= 0 ? 0 : (-r.start + r.stride - 1) / r.stride;
  if (first > r.count) first = r.count;
  std::int64_t last = r.start >= r.width ? 0 : (r.width - 1 - r.start) / r.stride + 1;
  if (r.width == 0 || last < first) last = first;
  if (last > r.count) last = r.count;
  const float* x = s.x + r.start + first * r.stride;
  if (s.channels < P::kLanes) return fill_rows_inside<P, 0, false>(s, x, r, y, first, last);
  if (r.stride == 1) return fill_rows_inside<P, 1, true>(s, x, r, y, first, last);
  if (r.stride == 2) return fill_rows_inside<P, 2, true>(s, x, r, y, first, last);
  fill_rows_inside<P, 0, true>(s, x, r, y, first, last);
}

bool range(const float* x, std::int64_t count, float* low, float* high) {
  constexpr int kSums = 4;                        // independent of each other, to hide latency
  Float least[kSums], most[kSums], zeros[kSums];  // 0·x: NaN once an x is NaN or infinite
  for (int s = 0; s < kSums; ++s) least[s] = most[s] = zeros[s] = simd::zero();
  std::int64_t i = 0;
  for (; i + kSums * kWidth <= count; i += kSums * kWidth) SLIDE_UNROLLED for (int s = 0; s < kSums; ++s) {
      const Float v = simd::load(x + i + s * kWidth);
      least[s] = simd::min(v, least[s]);
      most[s] = simd::max(v, most[s]);
      zeros[s] = simd::fma(v, simd::zero(), zeros[s]);
    }
  for (; i < count; i += kWidth) {
    const Float v = load_some(x + i, count - i);
    least[0] = simd::min(v, least[0]);
    most[0] = simd::max(v, most[0]);
    zeros[0] = simd::fma(v, simd::zero(), zeros[0]);
  }
  for (int s = 1; s < kSums; ++s) {
    least[0] = simd::min(least[s], least[0]);
    most[0] = simd::max(most[s], most[0]);
    zeros[0] = zeros[0] + zeros[s];
  }
  *high = simd::max_of_lanes(most[0]);
  *low = -simd::max_of_lanes(-least[0]);
  return simd::sum_of_lanes(zeros[0]) == 0;
}

}  // namespace
}  // namespace slide::ops::SLIDE_ISA
