#pragma once

// Depthwise filters, for sources compiled per level. A vector of output positions goes down a plane in steps
// of some rows, and all its steps share the rows of the input that they read: a tile of up to kSteps vectors
// of sums, for one column of the filter after the other, whose weights stay in registers.

#include "ops/conv2d/word_kernels.h"

namespace slide::ops::SLIDE_ISA {
namespace {

constexpr int kSteps = kWidth == 16 ? 8 : 4;

// Loops over accumulators are unrolled whole: an array that is indexed by a variable lies in memory.
#define SLIDE_UNROLLED_TAPS _Pragma("GCC unroll 24")

/// Adds `kTaps` taps, one row apart, to R sums that are `kStepRows` rows apart.
template <int R, int kStepRows, int kTaps>
SLIDE_INLINE void add_taps(const DepthwisePlane& p, const DepthwiseRun& run, const float* x,
                           Float (&sums)[R]) {
  Float weight[kTaps];
  SLIDE_UNROLLED_TAPS for (int n = 0; n < kTaps; ++n) weight[n] =
      simd::broadcast(p.weight[run.weight + n * p.weight_step]);
  SLIDE_UNROLLED_TAPS for (int r = 0; r < (R - 1) * kStepRows + kTaps; ++r) {
    const Float value = simd::load(x + r * p.width);
    SLIDE_UNROLLED_TAPS for (int k = 0; k < R; ++k) {
      const int n = r - k * kStepRows;
      if (n >= 0 && n < kTaps) sums[k] = simd::fma(weight[n], value, sums[k]);
    }
  }
}

template <int R, int kStepRows>
SLIDE_INLINE void add_run(const DepthwisePlane& p, const DepthwiseRun& run, const float* x,
                          Float (&sums)[R]) {
  if (run.taps == 1) return add_taps<R, kStepRows, 1>(p, run, x, sums);
  if (run.taps == 2) return add_taps<R, kStepRows, 2>(p, run, x, sums);
  if (run.taps == 3) return add_taps<R, kStepRows, 3>(p, run, x, sums);
  if (run.taps == 4) return add_taps<R, kStepRows, 4>(p, run, x, sums);
  add_taps<R, kStepRows, 5>(p, run, x, sums);
}

/// R steps from the position `first`.
template <int R, int kStepRows>
void depthwise_steps(const DepthwisePlane& p, std::int64_t first, float* y) {
  const std::int64_t step = kStepRows * p.width;
  for (std::int64_t j = 0; j < step && first + j < p.count; j += kWidth) {
    Float totals[R];
    Float sums[R];
    for (int k = 0; k < R; ++k) {
      totals[k] = simd::broadcast(p.bias);
      sums[k] = simd::zero();
    }
    for (std::int64_t i = 0; i < p.run_count; ++i) {
      const DepthwiseRun& run = p.runs[i];
      add_run<R, kStepRows>(p, run, p.x + run.offset + first + j, sums);
      if (run.mask == nullptr) continue;
      const Bits mask = load_words(run.mask + j);
      SLIDE_UNROLLED_TAPS for (int k = 0; k < R; ++k) {
        totals[k] = totals[k] + as_float(simd::bits_of(sums[k]) & mask);
        sums[k] = simd::zero();
      }
    }
    SLIDE_UNROLLED_TAPS for (int k = 0; k < R; ++k) {
      const std::int64_t at = first + k * step + j;
      const std::int64_t in_plane = p.count - at;
      const std::int64_t rest = step - j < in_plane ? step - j : in_plane;
      if (rest > 0) store_some(y + at, cut(totals[k], p.low, p.high), rest);
    }
  }
}

template <int kStepRows>
void depthwise_tiles(const DepthwisePlane& p, float* y) {
  const std::int64_t step = kStepRows * p.width;
  std::int64_t first = 0;
  for (; first + (kSteps - 1) * step < p.count; first += kSteps * step)
    depthwise_steps<kSteps, kStepRows>(p, first, y);
  for (; first + 3 * step < p.count; first += 4 * step) depthwise_steps<4, kStepRows>(p, first, y);
  for (; first + step < p.count; first += 2 * step) depthwise_steps<2, kStepRows>(p, first, y);
  if (first < p.count) depthwise_steps<1, kStepRows>(p, first, y);
}

void depthwise_plane(const DepthwisePlane& p, float* y) {
  if (p.step_rows == 1) return depthwise_tiles<1>(p, y);
  if (p.step_rows == 2) return depthwise_tiles<2>(p, y);
  depthwise_tiles<4>(p, y);
}

/// Columns 0, 2, ... and 1, 3, ... of a row of even length.
SLIDE_INLINE void split_row(const float* x, std::int64_t width, Float least, float* even, float* odd) {
  for (std::int64_t j = 0; j < width; j += 2 * kWidth, even += kWidth, odd += kWidth) {
    const std::int64_t rest = width - j;
    const Float low = simd::max(least, load_some(x + j, rest));
    const Float high =
        rest > kWidth ? simd::max(least, load_some(x + j + kWidth, rest - kWidth)) : simd::zero();
    store_some(even, simd::even(low, high), rest / 2);
    store_some(odd, simd::odd(low, high), rest / 2);
  }
}

void split_plane(const float* x, std::int64_t rows, std::int64_t width, float least, float* y,
                 std::int64_t phase_size) {
  for (std::int64_t row = 0; row < rows; ++row, x += width) {
    float* even = y + row % 2 * 2 * phase_size + row / 2 * (width / 2);
    split_row(x, width, simd::broadcast(least), even, even + phase_size);
  }
}

}  // namespace
}  // namespace slide::ops::SLIDE_ISA
