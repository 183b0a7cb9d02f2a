// The register-blocked product of panels: kRows rows of the left matrix (output channels) by kVectors vectors
// of the right one (output positions). All kRows·kVectors accumulators stay in registers over the whole
// depth; for each k the vectors of b are loaded once and multiplied by kRows broadcast values of a. b (depth
// × columns) stays in the first-level cache, a streams.

#include "ops/conv2d/conv2d_routines.h"
#include "ops/conv2d/depthwise/depthwise_kernels.h"
#include "ops/conv2d/few_filters/few_filters_kernels.h"
#include "ops/conv2d/word_kernels.h"
#if defined(SLIDE_TILES)
#include "ops/conv2d/tile_kernels.h"
#endif
#include "ops/simd/math.h"

namespace slide::ops::SLIDE_ISA {
namespace {

#if !defined(SLIDE_TILES)
template <int R, int V>
SLIDE_INLINE void multiply_panel(const float* a, const float* b, std::int64_t depth, float* c) {
  Float sums[R][V];
  for (int m = 0; m < R; ++m)
    for (int v = 0; v < V; ++v) sums[m][v] = simd::zero();
  for (std::int64_t k = 0; k < depth; ++k, a += kRows, b += kColumns) {
    Float right[V];
    for (int v = 0; v < V; ++v) right[v] = simd::load(b + v * kWidth);
    for (int m = 0; m < R; ++m) {
      const Float left = simd::broadcast(a[m]);
      for (int v = 0; v < V; ++v) sums[m][v] = simd::fma(left, right[v], sums[m][v]);
    }
  }
  for (int m = 0; m < R; ++m)
    for (int v = 0; v < V; ++v) {
      float* target = c + m * kColumns + v * kWidth;
      simd::store(target, simd::load(target) + sums[m][v]);
    }
}

template <int R>
void multiply_rows(const float* a, const float* b, std::int64_t depth, float* c, std::int64_t column_count) {
  if constexpr (kVectors > 2)
    if (column_count > 2 * kWidth) return multiply_panel<R, kVectors>(a, b, depth, c);
  if (column_count > kWidth) return multiply_panel<R, 2>(a, b, depth, c);
  multiply_panel<R, 1>(a, b, depth, c);
}

void multiply(const float* a, const float* b, std::int64_t depth, float* c, std::int64_t row_count,
              std::int64_t column_count) {
  if (row_count > 4) return multiply_rows<kRows>(a, b, depth, c, column_count);
  if (row_count > 2) return multiply_rows<4>(a, b, depth, c, column_count);
  if (row_count > 1) return multiply_rows<2>(a, b, depth, c, column_count);
  multiply_rows<1>(a, b, depth, c, column_count);
}

void nothing() {}
#endif

SLIDE_INLINE std::int64_t clamp(std::int64_t value, std::int64_t low, std::int64_t high) {
  return value < low ? low : value > high ? high : value;
}

SLIDE_INLINE void fill_zeros(float* y, std::int64_t count) {
  for (std::int64_t j = 0; j < count; ++j) y[j] = 0;
}

/// y[j] = x[start + j·stride] where that is in [0, width), else 0.
SLIDE_INLINE void pack_row(const float* x, std::int64_t width, std::int64_t start, std::int64_t stride,
                           float* y, std::int64_t count) {
  if (stride == 1) {
    const std::int64_t first = clamp(-start, 0, count);
    const std::int64_t last = clamp(width - start, first, count);
    fill_zeros(y, first);
    std::int64_t j = first;
    for (; j + kWidth <= last; j += kWidth) simd::store(y + j, simd::load(x + start + j));
    for (; j < last; ++j) y[j] = x[start + j];
    fill_zeros(y + last, count - last);
    return;
  }
  const std::int64_t first = clamp(start >= 0 ? 0 : (-start + stride - 1) / stride, 0, count);
  const std::int64_t last = clamp(start >= width ? 0 : (width - 1 - start) / stride + 1, first, count);
  fill_zeros(y, first);
  for (std::int64_t j = first; j < last; ++j) y[j] = x[start + j * stride];
  fill_zeros(y + last, count - last);
}

void pack_columns(const ColumnSource& s, std::int64_t first, std::int64_t count, std::int64_t first_k,
                  std::int64_t last_k, float* b) {
  const std::int64_t first_row = first / s.owidth;
  const std::int64_t first_column = first % s.owidth;
  std::int64_t v = first_k % s.kwidth;
  std::int64_t u = first_k / s.kwidth % s.kheight;
  const float* plane = s.x + first_k / s.kwidth / s.kheight * s.height * s.width;
  for (std::int64_t k = first_k; k < last_k; ++k, b += kColumns) {
    std::int64_t row = first_row * s.stride_y + u * s.dilation_y - s.top;
    std::int64_t column = first_column;
    for (std::int64_t done = 0; done < count;) {
      const std::int64_t rest = count - done;
      const std::int64_t length = s.owidth - column < rest ? s.owidth - column : rest;
      if (row >= 0 && row < s.height)
        pack_row(plane + row * s.width, s.width, column * s.stride_x + v * s.dilation_x - s.left, s.stride_x,
                 b + done, length);
      else
        fill_zeros(b + done, length);
      done += length;
      column = 0;
      row += s.stride_y;
    }
    fill_zeros(b + count, kColumns - count);
    if (++v < s.kwidth) continue;
    v = 0;
    if (++u < s.kheight) continue;
    u = 0;
    plane += s.height * s.width;
  }
}

void gate(const float* a, const float* g, float* y, std::int64_t count) {
  for (std::int64_t j = 0; j < count; j += kWidth) {
    const Float value = simd::elu(simd::load(a + j)) * simd::sigmoid(simd::load(g + j));
    if (j + kWidth <= count)
      simd::store(y + j, value);
    else
      simd::store_partial(y + j, value, static_cast<std::size_t>(count - j));
  }
}

template <int V>
SLIDE_INLINE void depthwise_block(const DepthwiseRow& row, std::int64_t j, Float (&sums)[V]) {
  for (int v = 0; v < V; ++v) sums[v] = simd::broadcast(row.bias);
  for (std::int64_t t = 0; t < row.count; ++t) {
    const Float weight = simd::broadcast(row.weight[t]);
    for (int v = 0; v < V; ++v)
      sums[v] = simd::fma(weight, simd::load(row.x + row.offsets[t] + j + v * kWidth), sums[v]);
  }
  for (int v = 0; v < V; ++v) sums[v] = cut(sums[v], row.low, row.high);
}

void depthwise_row(const DepthwiseRow& row, float* y, std::int64_t count) {
  constexpr int kBlock = 4;  // enough independent sums to hide the latency of fma
  std::int64_t j = 0;
  for (; j + kBlock * kWidth <= count; j += kBlock * kWidth) {
    Float sums[kBlock];
    depthwise_block(row, j, sums);
    for (int v = 0; v < kBlock; ++v) simd::store(y + j + v * kWidth, sums[v]);
  }
  for (; j < count; j += kWidth) {
    Float sum[1];
    depthwise_block(row, j, sum);
    store_some(y + j, sum[0], count - j);
  }
}

}  // namespace

extern const Conv2dRoutines conv2d_routines;
const Conv2dRoutines conv2d_routines {
  Isa::SLIDE_ISA_ENUM,
#if defined(SLIDE_TILES)
      false, {false, true, true},
#elif defined(SLIDE_WORD_LEVEL) && defined(__ARM_FEATURE_BF16_VECTOR_ARITHMETIC)
      false, {false, true, false},
#elif defined(SLIDE_WORD_LEVEL)
      false, {false, false, true},
#else
      true, {true, true, true},
#endif
      Int8::kSplitsPairs, Int8::kByteOffset, Bf16::kSquares,
#if defined(__FMA__) || defined(__aarch64__)
      true,
#else
      false,
#endif
#if defined(SLIDE_TILES)
      kTileHeight, kColumns, kTileWords, nullptr, pack_columns,
      {nullptr, multiply_words_by_tiles<Bf16>, multiply_words_by_tiles<Int8>}, Tiles::configure,
      Tiles::release,
#else
      kRows, kColumns, 1, multiply, pack_columns,
      {multiply_words<Fp32>, multiply_words<Bf16>, multiply_words<Int8>}, nothing, nothing,
#endif
      {fill_rows<Fp32>, fill_rows<Bf16>, fill_rows<Int8>}, {gather<Fp32>, gather<Bf16>, gather<Int8>},
      gather_copies, range, gate, depthwise_row, depthwise_plane, split_plane,
      {kTileRows<1>, kTileRows<2>, kTileRows<3>, kTileRows<4>}, add_filters
};

}  // namespace slide::ops::SLIDE_ISA
