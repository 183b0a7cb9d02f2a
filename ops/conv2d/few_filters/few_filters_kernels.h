#pragma once

// Convolutions of few filters, for sources compiled per level. Each vector of the input is loaded once for
// each column of taps, and multiplied by all taps of that column in all filters: a tile of kTileRows rows of
// one vector has its sums in registers, while the input's rows stream by.

#include "ops/conv2d/word_kernels.h"
#include "ops/simd/fetch_ahead.h"

namespace slide::ops::SLIDE_ISA {
namespace {

/// Filters and rows of a tile whose sums are in registers beside the weights of a column of three taps and a
/// vector of the input: 32 registers (AVX-512, AArch64) or 16.
#if defined(__AVX512F__) || defined(__aarch64__)
constexpr int kTileFilters = 4;
template <int kFilters>
constexpr int kTileRows = kFilters == 1 ? 8 : 4;
#else
constexpr int kTileFilters = 2;
template <int kFilters>
constexpr int kTileRows = 4;
#endif

// Loops over accumulators are unrolled whole: an array that is indexed by a variable lies in memory.
#define SLIDE_UNROLLED_ROWS _Pragma("GCC unroll 16")

/// Which lanes of a vector at `first` of a row are inside of it.
struct Window {
#if defined(__AVX512F__)
  __mmask16 lanes;
#elif defined(__AVX2__)
  __m256i lanes;
#else
  std::int64_t begin, end;
#endif
};

SLIDE_INLINE Window window_at(std::int64_t first, std::int64_t width) {
  const std::int64_t begin = first >= 0 ? 0 : first > -kWidth ? -first : kWidth;
  const std::int64_t end = width - first < 0 ? 0 : width - first < kWidth ? width - first : kWidth;
#if defined(__AVX512F__)
  const std::uint32_t below = (1U << end) - 1U;
  return {static_cast<__mmask16>(below >> begin << begin)};
#elif defined(__AVX2__)
  const __m256i lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
  return {_mm256_andnot_si256(_mm256_cmpgt_epi32(_mm256_set1_epi32(static_cast<int>(begin)), lane),
                              _mm256_cmpgt_epi32(_mm256_set1_epi32(static_cast<int>(end)), lane))};
#else
  return {begin, end};
#endif
}

/// Zeros outside; nothing is read there.
SLIDE_INLINE Float load_inside(const float* x, const Window& window) {
#if defined(__AVX512F__)
  return {_mm512_maskz_loadu_ps(window.lanes, x)};
#elif defined(__AVX2__)
  return {_mm256_maskload_ps(x, window.lanes)};
#else
  float lanes[kWidth] = {};
  for (std::int64_t i = window.begin; i < window.end; ++i) lanes[i] = x[i];
  return simd::load(lanes);
#endif
}

/// x, loaded once: GCC 12 would read it from memory for each of its products, and loads are what takes time.
SLIDE_INLINE Float in_register(Float x) {
#if defined(__x86_64__)
  __asm__("" : "+v"(x.v));
#elif defined(__aarch64__)
  __asm__("" : "+w"(x.v));
#endif
  return x;
}

/// Adds the products of one column of taps. rows[r] + at is where the vectors are; window is null if they are
/// inside their rows.
template <int F, int kTaps, int R>
SLIDE_INLINE void add_column(const float* const* rows, std::int64_t at, const Window* window,
                             const float* weight, Float (&sums)[F][R]) {
  Float weights[F][kTaps];
  SLIDE_UNROLLED_ROWS for (int f = 0; f < F; ++f) {
    SLIDE_UNROLLED_ROWS for (int u = 0; u < kTaps; ++u) weights[f][u] =
        simd::broadcast(weight[f * kTaps + u]);
  }
  SLIDE_UNROLLED_ROWS for (int r = 0; r < R + kTaps - 1; ++r) {
    const Float x =
        in_register(window == nullptr ? simd::load(rows[r] + at) : load_inside(rows[r] + at, *window));
    SLIDE_UNROLLED_ROWS for (int f = 0; f < F; ++f) {
      SLIDE_UNROLLED_ROWS for (int k = 0; k < R; ++k) if (r >= k && r - k < kTaps) sums[f][k] =
          simd::fma(weights[f][r - k], x, sums[f][k]);
    }
  }
}

template <int F, int R>
SLIDE_INLINE void add_to(float* to, std::int64_t row_step, const Float (&sums)[F][R]) {
  SLIDE_UNROLLED_ROWS for (int f = 0; f < F; ++f) {
    SLIDE_UNROLLED_ROWS for (int k = 0; k < R; ++k) {
      float* y = to + (f * R + k) * row_step;
      simd::store(y, simd::load(y) + sums[f][k]);
    }
  }
}

/// Output positions j ... of all rows of a tile.
template <int F, int kTaps, bool kInside>
SLIDE_INLINE void add_vectors(const FilterTile& t, std::int64_t j) {
  constexpr int R = kTileRows<F>;
  Float sums[F][R];
  SLIDE_UNROLLED_ROWS for (int f = 0; f < F; ++f) {
    SLIDE_UNROLLED_ROWS for (int k = 0; k < R; ++k) sums[f][k] = simd::zero();
  }
  const float* weight = t.weight;
  const float* const* rows = t.rows;
  for (std::int64_t c = 0; c < t.channels; ++c, rows += R + kTaps - 1) {
    std::int64_t at = j - t.left;
    for (std::int64_t v = 0; v < t.kwidth; ++v, at += t.dilation_x, weight += t.filters * kTaps) {
      if (kInside) {
        add_column<F, kTaps>(rows, at, nullptr, weight, sums);
      } else {
        const Window window = window_at(at, t.width);
        add_column<F, kTaps>(rows, at, &window, weight, sums);
      }
    }
  }
  add_to(t.sums + j, t.sum_step, sums);
}

/// What is fetched at position j.
SLIDE_INLINE void fetch(const FilterAhead& a, std::int64_t j) {
  if (j % kRowAlignment != 0) return;
  const std::int64_t first = j / kRowAlignment * a.part;
  const std::int64_t last = first + a.part < a.count ? first + a.part : a.count;
  for (std::int64_t run = 0; run < a.runs; ++run)
    for (std::int64_t i = first; i < last; i += kRowAlignment) __builtin_prefetch(a.x + run * a.step + i);
}

template <int F, int kTaps>
void add_rows(const FilterTile& t) {
  const std::int64_t reach = (t.kwidth - 1) * t.dilation_x - t.left + kWidth;
  for (std::int64_t j = 0; j < t.count; j += kWidth) {
    fetch(t.ahead, j);
    if (j >= t.left && j + reach <= t.width)
      add_vectors<F, kTaps, true>(t, j);
    else
      add_vectors<F, kTaps, false>(t, j);
  }
}

/// One tap: V vectors of positions from j on. `end`: how many lanes of the last one there are.
template <int F, int V>
SLIDE_INLINE void add_positions(const FilterTile& t, std::int64_t j, std::int64_t end) {
  Float sums[F][V];
  SLIDE_UNROLLED_ROWS for (int f = 0; f < F; ++f) {
    SLIDE_UNROLLED_ROWS for (int v = 0; v < V; ++v) sums[f][v] = simd::zero();
  }
  for (std::int64_t c = 0; c < t.channels; ++c) {
    const float* x = t.rows[c] + j;
    SLIDE_UNROLLED_ROWS for (int v = 0; v < V; ++v) simd::fetch_ahead(x + v * kWidth);
    Float right[V];
    SLIDE_UNROLLED_ROWS for (int v = 0; v < V - 1; ++v) right[v] = simd::load(x + v * kWidth);
    right[V - 1] = load_some(x + (V - 1) * kWidth, end);
    SLIDE_UNROLLED_ROWS for (int f = 0; f < F; ++f) {
      const Float left = simd::broadcast(t.weight[c * t.filters + f]);
      SLIDE_UNROLLED_ROWS for (int v = 0; v < V; ++v) sums[f][v] = simd::fma(left, right[v], sums[f][v]);
    }
  }
  SLIDE_UNROLLED_ROWS for (int f = 0; f < F; ++f) {
    SLIDE_UNROLLED_ROWS for (int v = 0; v < V; ++v) {
      float* y = t.sums + f * t.sum_step + j + v * kWidth;
      simd::store(y, simd::load(y) + sums[f][v]);
    }
  }
}

template <int F>
void add_row(const FilterTile& t) {
  constexpr int V = kTileRows<F>;
  constexpr std::int64_t kStep = V * kWidth;
  std::int64_t j = 0;
  for (; j + kStep <= t.count; j += kStep) add_positions<F, V>(t, j, kWidth);
  for (; j < t.count; j += kWidth) add_positions<F, 1>(t, j, t.count - j);
}

/// The first F filters of a tile.
template <int F>
void add_filters_of(const FilterTile& t) {
  if (t.kheight == 1) return add_row<F>(t);
  if (t.kheight == 3) return add_rows<F, 3>(t);
  if (t.kheight == 5) return add_rows<F, 5>(t);
  add_rows<F, 7>(t);
}

void add_filters(const FilterTile& t) {
  FilterTile rest = t;
  std::int64_t filters = t.filters;
  if constexpr (kTileFilters < 4) {
    for (; filters > kTileFilters; filters -= kTileFilters) {
      add_filters_of<kTileFilters>(rest);
      rest.weight += kTileFilters * t.kheight;
      rest.sums += kTileFilters * (t.kheight == 1 ? 1 : kTileRows<kTileFilters>)*t.sum_step;
      rest.ahead = {};  // all is asked for
    }
  } else {
    if (filters == 4) return add_filters_of<4>(t);
    if (filters == 3) return add_filters_of<3>(t);
  }
  if (filters == 2) return add_filters_of<2>(rest);
  add_filters_of<1>(rest);
}

}  // namespace
}  // namespace slide::ops::SLIDE_ISA
