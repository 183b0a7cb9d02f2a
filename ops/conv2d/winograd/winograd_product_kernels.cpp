// The products of Winograd convolutions, frequency by frequency: matrices of words.
//
// With tiles as lanes: kRows rows (output channels) by kVectors vectors of tiles. What is rounded here, the
// output transform multiplies, so sums are short: a block's accumulators and the sums of blocks both stay in
// registers where there are 32; where there are 16, the sums of blocks are on the stack.
//
// With filters as lanes: two vectors of filters by kTiles tiles, of which none is computed in vain, and one
// stream of weights through memory; a part of it is in the first-level cache while all tiles pass by. Sums of
// blocks are in memory between the parts, tile by tile, and are transposed at the end.

#include "ops/conv2d/winograd/winograd_routines.h"
#include "ops/conv2d/words.h"
#include "ops/simd/lanes.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

constexpr std::int64_t kWidth = simd::kWidth;

// Accumulators, those of a block of float32 too, the vectors of b and a broadcast fit into the registers.
#if defined(__AVX512F__) || defined(__aarch64__)
template <typename P>
constexpr int kRows = P::kLanes == 1 ? 4 : 8;
constexpr int kVectors = 3;
#elif defined(__FMA__)
template <typename P>
constexpr int kRows = 6;
constexpr int kVectors = 2;
#else
template <typename P>
constexpr int kRows = 4;
constexpr int kVectors = 2;
#endif
constexpr std::int64_t kColumns = kVectors * kWidth;

constexpr int kNear = 3, kFar = 2;  // of __builtin_prefetch: first-level cache, second-level cache

// Loops over accumulators are unrolled whole: an array that is indexed by a variable lies in memory.
#define SLIDE_UNROLLED _Pragma("GCC unroll 24")

/// R = rows of adjacent panels of weights by V vectors, of the words first .. last - 1.
template <typename P, int R, int V>
SLIDE_INLINE void multiply_block(const WinogradProduct& p, std::int64_t first, std::int64_t last,
                                 Float (&sums)[R][V]) {
  for (std::int64_t k = first; k < last; ++k) {
    const float* a = p.a + k * kRows<P>;
    const float* b = p.b + k * kColumns;
    for (int m = 0; m < R; m += kRows<P>) __builtin_prefetch(a + (p.depth * (R + m)), 0, kNear);
    __builtin_prefetch(p.next_b + k * kCacheLine, 0, kFar);
    Bits right[V];
    for (int v = 0; v < V; ++v) right[v] = load_words(b + v * kWidth);
    SLIDE_UNROLLED for (int m = 0; m < R; ++m) {
      const Bits left = broadcast_word(a + m / kRows<P> * kRows<P> * p.depth + m % kRows<P>);
      for (int v = 0; v < V; ++v) sums[m][v] = P::step(left, right[v], sums[m][v]);
    }
  }
}

template <typename P, int R, int V>
void multiply_panel(const WinogradProduct& p) {
  for (int panel = 0; panel * kRows<P> < R; ++panel)
    for (std::int64_t i = 0; i < p.ahead_lines; ++i)
      __builtin_prefetch(p.ahead + panel * p.ahead_stride + i * kCacheLine, 0, kFar);
  Float sums[R][V];
  SLIDE_UNROLLED for (int m = 0; m < R; ++m) for (int v = 0; v < V; ++v) sums[m][v] =
      p.add ? simd::load(p.c + m * p.c_stride + v * kWidth) : simd::zero();
  if constexpr (P::kLanes > 1) {
    multiply_block<P, R, V>(p, 0, p.depth, sums);
  } else {
    for (std::int64_t k = 0; k < p.depth; k += p.block) {
      Float block[R][V];
      SLIDE_UNROLLED for (int m = 0; m < R; ++m) for (int v = 0; v < V; ++v) block[m][v] = simd::zero();
      multiply_block<P, R, V>(p, k, k + p.block < p.depth ? k + p.block : p.depth, block);
      SLIDE_UNROLLED for (int m = 0; m < R; ++m) for (int v = 0; v < V; ++v) sums[m][v] =
          sums[m][v] + block[m][v];
    }
  }
  SLIDE_UNROLLED for (int m = 0; m < R; ++m) for (int v = 0; v < V; ++v)
      simd::store(p.c + m * p.c_stride + v * kWidth, sums[m][v]);
}

/// What is left of a panel of R rows at most.
template <typename P, int R, int V>
void multiply_rest(const WinogradProduct& p) {
  if constexpr (R > 2)
    if (p.row_count <= R - 2) return multiply_rest<P, R - 2, V>(p);
  multiply_panel<P, R, V>(p);
}

template <typename P, int V>
void multiply_panels(WinogradProduct p) {
  const auto advance = [&p](std::int64_t panels) {
    p.a += panels * p.depth * kRows<P>;
    p.c += panels * kRows<P> * p.c_stride;
    p.next_b += panels * p.depth * kCacheLine;
    p.ahead += panels * p.ahead_stride;
    p.row_count -= panels * kRows<P>;
  };
  // Of one vector of columns, more rows at once: sums enough to hide how long an addition takes.
  constexpr int kNarrowPanels = (P::kLanes == 1 ? 12 : 16) / kRows<P>;
  if constexpr (V == 1)
    for (; p.row_count >= kNarrowPanels * kRows<P>; advance(kNarrowPanels))
      multiply_panel<P, kNarrowPanels * kRows<P>, V>(p);
  for (; p.row_count >= kRows<P>; advance(1)) multiply_panel<P, kRows<P>, V>(p);
  if (p.row_count > 0) multiply_rest<P, kRows<P>, V>(p);
}

template <typename P>
void multiply(const WinogradProduct& p) {
  if constexpr (kVectors > 2)
    if (p.column_count > 2 * kWidth) return multiply_panels<P, kVectors>(p);
  if (p.column_count > kWidth) return multiply_panels<P, 2>(p);
  multiply_panels<P, 1>(p);
}

// Filters as lanes.

#if defined(__AVX512F__) || defined(__aarch64__)
template <typename P>
constexpr int kTiles = P::kLanes == 1 ? 6 : 12;
#else
template <typename P>
constexpr int kTiles = 6;
#endif
// Beyond, the other product's panels of tiles are filled well, and what it leaves stays in nearer caches; of
// bfloat16 it leaves as much after half the steps.
#if defined(__FMA__) || defined(__aarch64__)
template <typename P>
constexpr std::int64_t kMostTiles = P::kLanes == 1 ? 112 : 64;
#else
template <typename P>
constexpr std::int64_t kMostTiles = 8;
#endif
constexpr int kFilters = 2 * kWidth;
constexpr std::int64_t kPartWords = (16 << 10) / (kFilters * sizeof(float));  // in the first-level cache

/// What R adjacent tiles of one panel take from a part of the weights.
struct TileProduct {
  const float* a;
  const float* b;
  std::int64_t columns;  // from word to word of b
  std::int64_t depth, block;
  bool add;
  float* sums;          // [tile][filter]
  const float* next_b;  // as b, of the tiles that follow; the line of the last is fetched
  const float* ahead;   // for each word ahead_step numbers that are wanted in the second-level cache
  std::int64_t ahead_step;
};

template <typename P, int R>
SLIDE_INLINE void multiply_tile_words(const TileProduct& p, std::int64_t first, std::int64_t last,
                                      Float (&sums)[R][2]) {
  for (std::int64_t k = first; k < last; ++k) {
    const float* b = p.b + k * p.columns;
    __builtin_prefetch(p.next_b + k * p.columns + (kTiles<P> - 1), 0, kNear);
    const Bits left[2] = {load_words(p.a + k * kFilters), load_words(p.a + k * kFilters + kWidth)};
    SLIDE_UNROLLED for (int t = 0; t < R; ++t) {
      const Bits right = broadcast_word(b + t);
      for (int v = 0; v < 2; ++v) sums[t][v] = P::step(left[v], right, sums[t][v]);
    }
  }
}

SLIDE_INLINE void fetch_ahead(const TileProduct& p, std::int64_t first, std::int64_t last) {
  for (std::int64_t n = first * p.ahead_step; n < last * p.ahead_step; n += kCacheLine)
    __builtin_prefetch(p.ahead + n, 0, kFar);
}

template <typename P, int R>
void multiply_tiles(const TileProduct& p) {
  Float sums[R][2];
  SLIDE_UNROLLED for (int t = 0; t < R; ++t) for (int v = 0; v < 2; ++v) sums[t][v] =
      p.add ? simd::load(p.sums + t * kFilters + v * kWidth) : simd::zero();
  for (std::int64_t k = 0; k < p.depth; k += p.block) {
    const std::int64_t end = k + p.block < p.depth ? k + p.block : p.depth;
    fetch_ahead(p, k, end);
    if constexpr (P::kLanes > 1) {
      multiply_tile_words<P, R>(p, k, end, sums);
    } else {
      Float block[R][2];
      SLIDE_UNROLLED for (int t = 0; t < R; ++t) for (int v = 0; v < 2; ++v) block[t][v] = simd::zero();
      multiply_tile_words<P, R>(p, k, end, block);
      SLIDE_UNROLLED for (int t = 0; t < R; ++t) for (int v = 0; v < 2; ++v) sums[t][v] =
          sums[t][v] + block[t][v];
    }
  }
  SLIDE_UNROLLED for (int t = 0; t < R; ++t) for (int v = 0; v < 2; ++v)
      simd::store(p.sums + t * kFilters + v * kWidth, sums[t][v]);
}

/// `count` <= R tiles, and perhaps another of their panel.
template <typename P, int R>
void multiply_some_tiles(const TileProduct& p, std::int64_t count) {
  if constexpr (R > 2)
    if (count <= R - 2) return multiply_some_tiles<P, R - 2>(p, count);
  multiply_tiles<P, R>(p);
}

/// Numbers of lane i of vector j change places with those of lane j of vector i.
SLIDE_INLINE void transpose(Float (&v)[kWidth]) {
  for (int step = 1; step < kWidth; step *= 2) {
    Float zipped[kWidth];
    SLIDE_UNROLLED for (int i = 0; i < kWidth / 2; ++i) {
      zipped[2 * i] = simd::zip_low(v[i], v[i + kWidth / 2]);
      zipped[2 * i + 1] = simd::zip_high(v[i], v[i + kWidth / 2]);
    }
    SLIDE_UNROLLED for (int i = 0; i < kWidth; ++i) v[i] = zipped[i];
  }
}

void transpose_sums(const WinogradFilterProduct& p) {
  for (std::int64_t first = 0; first < p.row_count; first += kWidth) {
    const std::int64_t rows = p.row_count - first < kWidth ? p.row_count - first : kWidth;
    for (std::int64_t t = 0; t < p.tiles; t += kWidth) {
      Float v[kWidth];
      SLIDE_UNROLLED for (int i = 0; i < kWidth; ++i) v[i] = simd::load(p.sums + (t + i) * kFilters + first);
      transpose(v);
      float* c = p.c + first * p.c_stride + t;
      SLIDE_UNROLLED for (int i = 0; i < kWidth; ++i) if (i < rows) simd::store(c + i * p.c_stride, v[i]);
    }
  }
}

/// Of `count` tiles those of the first of equal parts of at most R: small parts take as long as larger ones.
template <int R>
SLIDE_INLINE std::int64_t even_share(std::int64_t count) {
  const std::int64_t parts = (count + R - 1) / R;
  const std::int64_t share = ((count + parts - 1) / parts + 1) / 2 * 2;
  return share < count ? share : count;
}

template <typename P>
void multiply_filters(const WinogradFilterProduct& p) {
  constexpr int R = kTiles<P>;
  const std::int64_t part = kPartWords / p.block > 0 ? kPartWords / p.block * p.block : p.block;
  const std::int64_t groups = (p.tiles + R - 1) / R;
  TileProduct tiles{};
  tiles.columns = p.columns;
  tiles.block = p.block;
  tiles.ahead_step = (p.ahead_step + groups - 1) / groups;
  for (std::int64_t k = 0; k < p.depth; k += part) {
    tiles.a = p.a + k * kFilters;
    tiles.depth = p.depth - k < part ? p.depth - k : part;
    tiles.add = p.add || k > 0;
    tiles.ahead = p.ahead + k * p.ahead_step;
    tiles.next_b = p.b + k * p.columns;
    for (std::int64_t t = 0; t < p.tiles;) {
      const std::int64_t column = t % p.columns;
      const std::int64_t end = p.tiles - t < p.columns - column ? p.tiles : t + p.columns - column;
      const std::int64_t next = t + even_share<R>(end - t);
      tiles.b = tiles.next_b;
      tiles.next_b =
          p.b + (next < p.tiles ? next / p.columns * p.panel_stride + next % p.columns + k * p.columns
                                : (k + tiles.depth) * p.columns);
      tiles.sums = p.sums + t * kFilters;
      multiply_some_tiles<P, R>(tiles, next - t);
      tiles.ahead += tiles.ahead_step * tiles.depth;
      t = next;
    }
  }
  if (p.last) transpose_sums(p);
}

}  // namespace

extern const WinogradMultiplier winograd_multipliers[2];
const WinogradMultiplier winograd_multipliers[2] = {
    {kRows<Fp32>, kColumns, multiply<Fp32>, kFilters, kTiles<Fp32>, kMostTiles<Fp32>, multiply_filters<Fp32>},
    {kRows<Bf16>, kColumns, multiply<Bf16>, kFilters, kTiles<Bf16>, kMostTiles<Bf16>,
     multiply_filters<Bf16>}};

}  // namespace slide::ops::SLIDE_ISA
