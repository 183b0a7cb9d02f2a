// The transforms of Winograd convolutions.
//
// Transforms: lanes = adjacent tiles of a line. Input: the vertical transform runs along whole image rows,
// where neighbouring tiles share their columns; its rows are split into the phases of the columns (column
// m·t + p of tile t is phase p, lane t), which the horizontal transform takes. Output: both transforms in
// registers, and the columns' vectors are zipped into rows, which residual and clamp finish.
//
// With points 0, ±p_1 .. ±p_N, ∞ the rows of Bᵀ are products of the factors L_k = x² - p_k² and x² ± p_k·x:
// an even and an odd half, each from nested L_k, shared by a pair. All coefficients are p and p², so a term
// meets N roundings at most. Of Aᵀ, a pair's sum gives the even rows, its difference the odd ones.

#include <utility>

#include "ops/conv2d/winograd/winograd_routines.h"
#include "ops/conv2d/words.h"
#include "ops/simd/lanes.h"
#include "ops/simd/non_temporal.h"
#include "ops/simd/partial.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

constexpr std::int64_t kWidth = simd::kWidth;

/// high - square·low: the factor x² - p² at x^i, where low and high are the coefficients of x^i and x^(i+2).
SLIDE_INLINE Float factor(Float square, Float low, Float high) { return simd::fma(-square, low, high); }

/// x²·Q and x·Q for the pairs' Q, the product of the other pairs' factors; and the product of all factors
/// over the inputs base, base + 2, ... . d is every second input: Q is taken of d[first ..].
template <int N>
SLIDE_INLINE Float all_factors(const Float* square, const Float* d) {
  if constexpr (N == 1) {
    return factor(square[0], d[0], d[1]);
  } else {
    return factor(square[N - 1], all_factors<N - 1>(square, d), all_factors<N - 1>(square, d + 1));
  }
}

/// Product of all factors but k, for k < N, of d[0 .. N-1].
template <int N>
SLIDE_INLINE void other_factors(const Float* square, const Float* d, Float* q) {
  if constexpr (N == 1) {
    q[0] = d[0];
  } else if constexpr (N == 2) {
    q[0] = factor(square[1], d[0], d[1]);
    q[1] = factor(square[0], d[0], d[1]);
  } else {
    const Float low = factor(square[1], d[0], d[1]);
    const Float high = factor(square[1], d[1], d[2]);
    q[0] = factor(square[2], low, high);
    q[2] = factor(square[0], low, high);
    q[1] = factor(square[2], factor(square[0], d[0], d[1]), factor(square[0], d[1], d[2]));
  }
}

/// Bᵀ d in place.
template <int M>
SLIDE_INLINE void transform_input(const Float* square, const Float* point, Float* d) {
  constexpr int N = M / 2;
  Float even[N + 1], odd[N + 1];
  for (int i = 0; i <= N; ++i) {
    even[i] = d[2 * i];
    odd[i] = d[2 * i + 1];
  }
  Float e[N], o[N];
  other_factors<N>(square, even + 1, e);
  other_factors<N>(square, odd, o);
  d[0] = all_factors<N>(square, even);
  d[M + 1] = all_factors<N>(square, odd);
  for (int k = 0; k < N; ++k) {
    d[2 * k + 1] = simd::fma(point[k], o[k], e[k]);
    d[2 * k + 2] = simd::fma(-point[k], o[k], e[k]);
  }
}

/// Aᵀ m: M results in the first places of m.
template <int M>
SLIDE_INLINE void transform_output(const WinogradPoints& points, Float* m) {
  constexpr int N = M / 2;
  Float sum[N], difference[N], y[M];
  for (int k = 0; k < N; ++k) {
    sum[k] = m[2 * k + 1] + m[2 * k + 2];
    difference[k] = m[2 * k + 1] - m[2 * k + 2];
  }
  y[0] = m[0];
  for (int k = 0; k < N; ++k) y[0] = y[0] + sum[k];
  for (int i = 1; i < M; ++i) {
    const Float* part = i % 2 == 0 ? sum : difference;
    const Float first = simd::broadcast(points.power[0][i]);
    y[i] = i == M - 1 ? simd::fma(first, part[0], m[M + 1]) : first * part[0];
    for (int k = 1; k < N; ++k) y[i] = simd::fma(simd::broadcast(points.power[k][i]), part[k], y[i]);
  }
  for (int i = 0; i < M; ++i) m[i] = y[i];
}

using simd::even;
using simd::odd;
using simd::zip_high;
using simd::zip_low;

/// Columns M·t + p of kWidth tiles t, for p < M: phase[p].
template <int M>
SLIDE_INLINE void split_columns(const float* row, Float* phase) {
  static_assert(M == 2 || M == 4);
  Float v[M];
  for (int i = 0; i < M; ++i) v[i] = simd::load(row + i * kWidth);
  if constexpr (M == 2) {
    phase[0] = even(v[0], v[1]);
    phase[1] = odd(v[0], v[1]);
  } else {
    const Float low[2] = {even(v[0], v[1]), even(v[2], v[3])};
    const Float high[2] = {odd(v[0], v[1]), odd(v[2], v[3])};
    phase[0] = even(low[0], low[1]);
    phase[1] = even(high[0], high[1]);
    phase[2] = odd(low[0], low[1]);
    phase[3] = odd(high[0], high[1]);
  }
}

/// Phase p of groups of `dilation` adjacent columns, one for each of as many tiles: phases[p][t] is column p
/// of tile t.
template <int M>
void split_groups(const float* row, std::int64_t dilation, std::int64_t groups, float* phases,
                  std::int64_t size) {
  constexpr int kStep = 4;  // what is copied beyond a group, the next one overwrites
  for (std::int64_t group = 0; group < groups; ++group)
    for (int p = 0; p < M; ++p, row += dilation)
      for (std::int64_t j = 0; j < dilation; j += kStep)
        __builtin_memcpy(phases + p * size + group * dilation + j, row + j, kStep * sizeof(float));
}

/// Of channels to come the cache line from column j on of all rows but two, which the line before fetched.
template <int M>
SLIDE_INLINE void fetch_rows(const WinogradInput& in, const float* const* rows, std::int64_t j) {
  if (in.ahead != 0)
    for (int u = 2; u < M + 2; ++u) __builtin_prefetch(rows[u] + in.ahead + j);
}

/// The vertical transform of rows that hold each two columns once: it is the same for both. Of odd columns
/// the first is written twice, once before `to`.
template <int M>
SLIDE_INLINE void transform_doubled_rows(const Float* square, const Float* point, const WinogradInput& in,
                                         const float* const* rows, float* to) {
  const std::int64_t first = in.odd ? -1 : 0;
  for (std::int64_t j = first; j < in.count; j += 2 * kWidth) {
    const std::int64_t rest = in.count - j;
    fetch_rows<M>(in, rows, (j - first) / 2);
    Float d[M + 2];
    for (int u = 0; u < M + 2; ++u) d[u] = simd::load_some(rows[u] + (j - first) / 2, (rest + 1) / 2);
    if (in.relu)
      for (Float& value : d) value = simd::max(simd::zero(), value);
    transform_input<M>(square, point, d);
    for (int u = 0; u < M + 2; ++u) {
      simd::store_some(to + u * in.row_size + j, zip_low(d[u], d[u]), rest);
      if (rest > kWidth)
        simd::store_some(to + u * in.row_size + j + kWidth, zip_high(d[u], d[u]), rest - kWidth);
    }
  }
}

/// A quarter of `far` and three of `near`.
SLIDE_INLINE Float blend(Float far, Float near) {
  return simd::fma(simd::broadcast(0.75F), near, simd::broadcast(0.25F) * far);
}

/// The vertical transform of rows between which and between whose columns the image's lie: the rows are
/// blended and transformed, then the columns of the result blended.
template <int M>
SLIDE_INLINE void transform_blended_rows(const Float* square, const Float* point, const WinogradInput& in,
                                         int channel, float* to) {
  const std::int64_t first = in.odd ? -1 : 0;
  const std::int64_t pairs = (in.count - first + 1) / 2;
  const std::int64_t begin = in.left_edge ? 0 : -1, end = in.right_edge ? pairs : pairs + 1;
  const std::int64_t size = M * in.phase_size;
  float* low = in.phases + 1;
  for (std::int64_t k = begin; k < end; k += kWidth) {
    fetch_rows<M>(in, in.rows + channel * (M + 2), k - begin);
    Float d[M + 2];
    for (int u = 0; u < M + 2; ++u) {
      const int row = channel * (M + 2) + u;
      d[u] = blend(simd::load_some(in.far_rows[row] + k - begin, end - k),
                   simd::load_some(in.rows[row] + k - begin, end - k));
    }
    transform_input<M>(square, point, d);
    for (int u = 0; u < M + 2; ++u) simd::store(low + u * size + k, d[u]);
  }
  for (int u = 0; u < M + 2; ++u, low += size, to += in.row_size) {
    if (in.left_edge) low[-1] = low[0];
    if (in.right_edge) low[pairs] = low[pairs - 1];
    for (std::int64_t k = 0; k < pairs; k += kWidth) {
      const Float near = simd::load(low + k);
      const Float left = blend(simd::load(low + k - 1), near), right = blend(simd::load(low + k + 1), near);
      const std::int64_t j = first + 2 * k, rest = in.count - j;
      simd::store_some(to + j, zip_low(left, right), rest);
      if (rest > kWidth) simd::store_some(to + j + kWidth, zip_high(left, right), rest - kWidth);
    }
  }
}

/// The vertical transform of a line of one channel.
template <int M>
SLIDE_INLINE void transform_rows(const Float* square, const Float* point, const WinogradInput& in,
                                 int channel) {
  float* buffer = in.buffer + channel * (M + 2) * in.row_size;
  for (int u = 0; u < M + 2; ++u) {
    float* row = buffer + u * in.row_size;
    for (std::int64_t j = 0; j < in.left; ++j) row[j] = 0;
    for (std::int64_t j = in.left + in.count; j < in.used; ++j) row[j] = 0;
  }
  const float* rows[M + 2];
  for (int u = 0; u < M + 2; ++u) rows[u] = in.rows[channel * (M + 2) + u];
  if (in.blended) return transform_blended_rows<M>(square, point, in, channel, buffer + in.left);
  if (in.doubled) return transform_doubled_rows<M>(square, point, in, rows, buffer + in.left);
  for (std::int64_t j = 0; j < in.count; j += kWidth) {
    const bool whole = j + kWidth <= in.count;
    const auto rest = static_cast<std::size_t>(in.count - j);
    fetch_rows<M>(in, rows, j);
    Float d[M + 2];
    for (int u = 0; u < M + 2; ++u)
      d[u] = whole ? simd::load(rows[u] + j) : simd::load_partial(rows[u] + j, rest);
    if (in.relu)
      for (Float& value : d) value = simd::max(simd::zero(), value);
    transform_input<M>(square, point, d);
    float* to = buffer + in.left + j;
    for (int u = 0; u < M + 2; ++u) {
      if (whole)
        simd::store(to + u * in.row_size, d[u]);
      else
        simd::store_partial(to + u * in.row_size, d[u], rest);
    }
  }
}

/// The horizontal transform of one transformed row of each channel, to the panels: load(channel, t, d) gives
/// columns 0 .. M+1 of the tiles from t on.
template <int M, typename P, typename Load>
SLIDE_INLINE void transform_columns(const Float* square, const Float* point, const WinogradInput& in,
                                    const Load& load, float* v) {
  std::int64_t column = in.first % in.columns;
  float* panel = v + in.first / in.columns * in.panel_stride;
  for (std::int64_t t = 0; t < in.tiles;) {
    const std::int64_t end = in.tiles - t < in.columns - column ? in.tiles : t + in.columns - column;
    for (; t < end; t += kWidth, column += kWidth) {
      Float d[P::kLanes][M + 2];
      for (int channel = 0; channel < P::kLanes; ++channel) {
        load(channel, t, d[channel]);
        transform_input<M>(square, point, d[channel]);
      }
      float* to = panel + column;
      const std::int64_t room = in.columns - column;
      for (int f = 0; f < M + 2; ++f, to += in.frequency_stride) {
        Float lanes[P::kLanes];
        for (int channel = 0; channel < P::kLanes; ++channel) lanes[channel] = d[channel][f];
        const Float words = as_float(P::word(0, 0, lanes));
        __builtin_prefetch(to + in.columns, 1);  // the next word's place
        if (room >= kWidth)
          simd::store(to, words);
        else
          simd::store_partial(to, words, static_cast<std::size_t>(room));
      }
    }
    t = end;
    column = 0;
    panel += in.panel_stride;
  }
}

template <int M, typename P>
void input(const WinogradPoints& points, const WinogradInput& line) {
  const WinogradInput in = line;  // stores may change what a reference is to, as far as the compiler knows
  Float square[M / 2], point[M / 2];
  for (int k = 0; k < M / 2; ++k) {
    square[k] = simd::broadcast(points.square[k]);
    point[k] = simd::broadcast(points.power[k][1]);
  }
  for (int channel = 0; channel < P::kLanes; ++channel) transform_rows<M>(square, point, in, channel);
  if constexpr (M != 6) {
    if (in.dilation == 1) {
      for (int u = 0; u < M + 2; ++u) {
        const float* rows = in.buffer + u * in.row_size;
        const auto load = [rows, &in](int channel, std::int64_t t, Float* d) {
          const float* row = rows + channel * (M + 2) * in.row_size;
          split_columns<M>(row + M * t, d);
          for (int p = 0; p < 2; ++p) d[M + p] = simd::shift_in(d[p], row[M * (t + kWidth) + p]);
        };
        transform_columns<M, P>(square, point, in, load, in.v + u * (M + 2) * in.frequency_stride);
      }
      return;
    }
  }
  const std::int64_t groups = (in.tiles + in.dilation - 1) / in.dilation + 1;
  for (int u = 0; u < P::kLanes * (M + 2); ++u)
    split_groups<M>(in.buffer + u * in.row_size, in.dilation, groups, in.phases + u * M * in.phase_size,
                    in.phase_size);
  for (int u = 0; u < M + 2; ++u) {
    const auto load = [u, &in](int channel, std::int64_t t, Float* d) {
      const float* phases = in.phases + (channel * (M + 2) + u) * M * in.phase_size;
      for (int p = 0; p < M; ++p) d[p] = simd::load(phases + p * in.phase_size + t);
      for (int p = 0; p < 2; ++p) d[M + p] = simd::load(phases + p * in.phase_size + in.dilation + t);
    };
    transform_columns<M, P>(square, point, in, load, in.v + u * (M + 2) * in.frequency_stride);
  }
}

/// Rows of the tiles' columns, as adjacent columns.
template <int M>
SLIDE_INLINE void join_columns(const Float* y, Float* columns) {
  if constexpr (M == 2) {
    columns[0] = zip_low(y[0], y[1]);
    columns[1] = zip_high(y[0], y[1]);
  } else if constexpr (M == 4) {
    const Float a = zip_low(y[0], y[2]), b = zip_low(y[1], y[3]);
    const Float c = zip_high(y[0], y[2]), d = zip_high(y[1], y[3]);
    columns[0] = zip_low(a, b);
    columns[1] = zip_high(a, b);
    columns[2] = zip_low(c, d);
    columns[3] = zip_high(c, d);
  } else {
    float lanes[M][kWidth], joined[M * kWidth];
    for (int j = 0; j < M; ++j) simd::store(lanes[j], y[j]);
    for (int t = 0; t < simd::kWidth; ++t)
      for (int j = 0; j < M; ++j) joined[M * t + j] = lanes[j][t];
    for (int j = 0; j < M; ++j) columns[j] = simd::load(joined + j * kWidth);
  }
}

/// Row i of kWidth tiles, from the first on, at its place in y.
template <int M>
SLIDE_INLINE void finish_row(const WinogradOutput& run, const Float* row, int i, std::int64_t first) {
  Float columns[M];
  join_columns<M>(row, columns);
  const Float low = simd::broadcast(run.low), high = simd::broadcast(run.high);
  const std::int64_t at = i * run.row_size + M * first;
  const std::int64_t count = run.columns - M * first;
  for (int j = 0; j < M; ++j) {
    const std::int64_t rest = count - j * kWidth;
    if (rest <= 0) return;
    Float residual = simd::zero();
    if (run.residual != nullptr) residual = simd::load_some(run.residual + at + j * kWidth, rest);
    if (run.residual != nullptr && !run.residual_last) columns[j] = columns[j] + residual;
    columns[j] = simd::min(high, simd::max(low, columns[j]));
    if (run.residual != nullptr && run.residual_last) columns[j] = columns[j] + residual;
    if (run.non_temporal)
      simd::store_non_temporal(run.y + at + j * kWidth, columns[j], rest);
    else
      simd::store_some(run.y + at + j * kWidth, columns[j], rest);
  }
}

template <int M>
void output(const WinogradPoints& points, const WinogradOutput& run) {
  const Float bias = simd::broadcast(run.bias);
  for (std::int64_t t = 0; t < run.tiles; t += kWidth) {
    Float rows[M][M + 2];
    for (int f = 0; f < M + 2; ++f) {
      Float m[M + 2];
      for (int u = 0; u < M + 2; ++u) m[u] = simd::load(run.m + (u * (M + 2) + f) * run.frequency_stride + t);
      transform_output<M>(points, m);
      for (int i = 0; i < M; ++i) rows[i][f] = m[i];
    }
    for (int i = 0; i < M; ++i) {
      if (i >= run.rows) break;
      transform_output<M>(points, rows[i]);
      for (int j = 0; j < M; ++j) rows[i][j] = rows[i][j] + bias;
      if (run.interleave)
        finish_row<M>(run, rows[i], i, t);
      else
        for (int j = 0; j < M; ++j)
          simd::store(run.y + i * run.row_size + j * (run.row_size / M) + t, rows[i][j]);
    }
  }
}

}  // namespace

extern const WinogradMultiplier winograd_multipliers[2];
extern const WinogradRoutines winograd_routines;
const WinogradRoutines winograd_routines {
  Isa::SLIDE_ISA_ENUM,
#if defined(__FMA__) || defined(__aarch64__)
      true,
#else
      false,
#endif
      winograd_multipliers, {{input<2, Fp32>, input<2, Bf16>}, output<2>},
      {{input<4, Fp32>, input<4, Bf16>}, output<4>}, {
    {input<6, Fp32>, nullptr}, output<6>
  }
};

}  // namespace slide::ops::SLIDE_ISA
