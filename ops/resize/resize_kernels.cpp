// Along a row the taps are gathered: each output has its own indices and weights, tap by tap in separate
// arrays, so that compilers turn the loop into vector gathers where the level has them. Across rows it is a
// weighted sum of whole vectors.

#include "ops/resize/resize_routines.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::broadcast;
using simd::Float;
using simd::kWidth;

template <int Taps>
void gather(const float* __restrict x, const std::int32_t* __restrict index, const float* __restrict weight,
            float* __restrict y, std::size_t count) {
  for (std::size_t j = 0; j < count; ++j) {
    float sum = weight[j] * x[index[j]];
    for (std::size_t k = 1; k < Taps; ++k) sum += weight[k * count + j] * x[index[k * count + j]];
    y[j] = sum;
  }
}

void along_row(const float* x, const std::int32_t* index, const float* weight, int taps, float* y,
               std::size_t count) {
  if (taps == 4) return gather<4>(x, index, weight, y, count);
  if (taps == 2) return gather<2>(x, index, weight, y, count);
  for (std::size_t j = 0; j < count; ++j) y[j] = x[index[j]];
}

template <int Taps>
void blend(const float* const* rows, const float* weight, float* y, std::size_t count) {
  std::size_t j = 0;
  for (; j + kWidth <= count; j += kWidth) {
    Float sum = broadcast<>(weight[0]) * simd::load(rows[0] + j);
    for (int k = 1; k < Taps; ++k) sum = fma(broadcast<>(weight[k]), simd::load(rows[k] + j), sum);
    simd::store(y + j, sum);
  }
  for (; j < count; ++j) {
    float sum = weight[0] * rows[0][j];
    for (int k = 1; k < Taps; ++k) sum += weight[k] * rows[k][j];
    y[j] = sum;
  }
}

void across_rows(const float* const* rows, const float* weight, int taps, float* y, std::size_t count) {
  if (taps == 4) return blend<4>(rows, weight, y, count);
  if (taps == 2) return blend<2>(rows, weight, y, count);
  __builtin_memcpy(y, rows[0], count * sizeof(float));
}

}  // namespace

extern const ResizeRoutines resampling;
const ResizeRoutines resampling{Isa::SLIDE_ISA_ENUM, along_row, across_rows};

}  // namespace slide::ops::SLIDE_ISA
