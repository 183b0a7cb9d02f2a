#pragma once

// The products of words by tiles: 16 rows of a by up to three times 16 columns of b, 16 words of the depth at
// a time. Sums stay in their tiles over a block of the depth, and between the blocks in p.sums.

#include "ops/conv2d/tiles.h"
#include "ops/conv2d/word_kernels.h"

namespace slide::ops::SLIDE_ISA {
namespace {

static_assert(kColumns == 3 * kTileWords);

template <typename P, int C, int A, int B>
SLIDE_INLINE void add_tiles(Tiles& tiles) {
  if constexpr (P::kLanes == 2)
    tiles.add_bf16<C, A, B>();
  else
    tiles.add_int8<C, A, B>();
}

/// T0, T1, T2: sums; T3: a; T4, T5, T6: b.
template <typename P, int V>
SLIDE_INLINE void multiply_tiles(const WordProduct& p) {
  Tiles tiles;
  if (p.first) {
    tiles.zero<0>();
    if (V > 1) tiles.zero<1>();
    if (V > 2) tiles.zero<2>();
  } else {
    tiles.load<0>(p.sums, kColumns);
    if (V > 1) tiles.load<1>(p.sums + kTileWords, kColumns);
    if (V > 2) tiles.load<2>(p.sums + 2 * kTileWords, kColumns);
  }
  const float* a = p.a;
  const float* b = p.b;
  for (std::int64_t k = 0; k < p.depth;
       k += kTileWords, a += kTileHeight * kTileWords, b += kTileWords * kColumns) {
    tiles.load<3>(a, kTileWords);
    tiles.load<4>(b, kColumns);
    add_tiles<P, 0, 3, 4>(tiles);
    if (V > 1) {
      tiles.load<5>(b + kTileWords, kColumns);
      add_tiles<P, 1, 3, 5>(tiles);
    }
    if (V > 2) {
      tiles.load<6>(b + 2 * kTileWords, kColumns);
      add_tiles<P, 2, 3, 6>(tiles);
    }
  }
  tiles.store<0>(p.sums, kColumns);
  if (V > 1) tiles.store<1>(p.sums + kTileWords, kColumns);
  if (V > 2) tiles.store<2>(p.sums + 2 * kTileWords, kColumns);
}

/// What the last block does with finished sums of one row.
template <typename P>
SLIDE_INLINE void write_row(WordProduct row, const float* sums) {
  const typename P::Sum start = P::start(row.start);
  row.row_count = 1;
  for (std::int64_t j = 0; j < row.column_count; j += kWidth) {
    const typename P::Sum sum[1][1] = {{P::add(P::load(sums + j), start)}};
    write_sums<P>(row, sum, row.column_count - j);
    row.y += kWidth;
    if (row.residual != nullptr) row.residual += kWidth;
  }
}

/// What the last block will read or write behind its sums comes closer while they are made.
SLIDE_INLINE void fetch_rows(const WordProduct& p) {
  for (std::int64_t m = 0; m < p.row_count; ++m)
    for (std::int64_t j = 0; j < p.column_count; j += kTileWords) {
      if (p.residual != nullptr)
        __builtin_prefetch(p.residual + m * p.y_stride + j);
      else
        __builtin_prefetch(p.y + m * p.y_stride + j, 1);
    }
}

template <typename P>
void multiply_words_by_tiles(const WordProduct& p) {
  for (std::int64_t j = 0; j < p.ahead_count; j += kRowAlignment) __builtin_prefetch(p.ahead + j, 0, 2);
  if (p.last) fetch_rows(p);
  if (p.column_count > 2 * kTileWords)
    multiply_tiles<P, 3>(p);
  else if (p.column_count > kTileWords)
    multiply_tiles<P, 2>(p);
  else
    multiply_tiles<P, 1>(p);
  if (!p.last) return;
  WordProduct row = p;
  for (std::int64_t m = 0; m < p.row_count; ++m) {
    write_row<P>(row, p.sums + m * kColumns);
    ++row.start;
    ++row.step;
    ++row.bias;
    row.y += p.y_stride;
    if (row.residual != nullptr) row.residual += p.y_stride;
  }
}

}  // namespace
}  // namespace slide::ops::SLIDE_ISA
