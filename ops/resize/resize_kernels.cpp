// Along a row the taps are gathered: each output has its own indices and weights, tap by tap in separate
// arrays, so that compilers turn the loop into vector gathers where the level has them. Of two taps, a vector
// of outputs that reads no more than a vector of inputs, as in upsampling, takes them from one register where
// the level can permute by variable indices. Across rows it is a weighted sum of whole vectors.

#include "ops/resize/resize_routines.h"
#include "ops/simd/fetch_ahead.h"
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

#if defined(__AVX512F__)
constexpr __mmask16 kAllLanes = 0xFFFF;  // g++ 12 takes the form without a mask for one of undefined lanes

/// Two taps of outputs whose indices never decrease.
void gather_pairs(const float* x, const std::int32_t* index, const float* weight, float* y,
                  std::size_t count) {
  std::size_t j = 0;
  for (; j + kWidth <= count; j += kWidth) {
    const std::int32_t first = index[j];
    const std::int32_t reach = index[count + j + kWidth - 1] - first + 1;
    if (reach > kWidth) {
      for (std::size_t i = j; i < j + kWidth; ++i)
        y[i] = weight[i] * x[index[i]] + weight[count + i] * x[index[count + i]];
      continue;
    }
    const Float from = reach == kWidth ? simd::load(x + first)
                                       : simd::load_partial(x + first, static_cast<std::size_t>(reach));
    simd::fetch_ahead(x + first);
    const __m512i start = _mm512_set1_epi32(first);
    const auto tap = [&](std::size_t at) {
      return Float{_mm512_maskz_permutexvar_ps(
          kAllLanes, _mm512_sub_epi32(_mm512_loadu_si512(index + at), start), from.v)};
    };
    simd::store(y + j, simd::load(weight + j) * tap(j) + simd::load(weight + count + j) * tap(count + j));
  }
  for (; j < count; ++j) y[j] = weight[j] * x[index[j]] + weight[count + j] * x[index[count + j]];
}
#else
void gather_pairs(const float* x, const std::int32_t* index, const float* weight, float* y,
                  std::size_t count) {
  gather<2>(x, index, weight, y, count);
}
#endif

void along_row(const float* x, const std::int32_t* index, const float* weight, int taps, float* y,
               std::size_t count) {
  if (taps == 4) return gather<4>(x, index, weight, y, count);
  if (taps == 2) return gather_pairs(x, index, weight, y, count);
  for (std::size_t j = 0; j < count; ++j) y[j] = x[index[j]];
}

template <int Taps, bool Residual>
void blend(const float* const* rows, const float* weight, const float* residual, float* y,
           std::size_t count) {
  std::size_t j = 0;
  for (; j + kWidth <= count; j += kWidth) {
    simd::own_ahead(y + j);
    Float sum = broadcast<>(weight[0]) * simd::load(rows[0] + j);
    for (int k = 1; k < Taps; ++k) sum = fma(broadcast<>(weight[k]), simd::load(rows[k] + j), sum);
    if constexpr (Residual) {
      simd::fetch_ahead(residual + j);
      sum = sum + simd::load(residual + j);
    }
    simd::store(y + j, sum);
  }
  for (; j < count; ++j) {
    float sum = weight[0] * rows[0][j];
    for (int k = 1; k < Taps; ++k) sum += weight[k] * rows[k][j];
    y[j] = Residual ? sum + residual[j] : sum;
  }
}

template <bool Residual>
void blend_taps(const float* const* rows, const float* weight, int taps, const float* residual, float* y,
                std::size_t count) {
  if (taps == 4) return blend<4, Residual>(rows, weight, residual, y, count);
  if (taps == 2) return blend<2, Residual>(rows, weight, residual, y, count);
  blend<1, Residual>(rows, weight, residual, y, count);  // times 1: exact
}

void across_rows(const float* const* rows, const float* weight, int taps, const float* residual, float* y,
                 std::size_t count) {
  if (residual != nullptr) return blend_taps<true>(rows, weight, taps, residual, y, count);
  if (taps == 1)
    __builtin_memcpy(y, rows[0], count * sizeof(float));
  else
    blend_taps<false>(rows, weight, taps, nullptr, y, count);
}

}  // namespace

extern const ResizeRoutines resampling;
const ResizeRoutines resampling{Isa::SLIDE_ISA_ENUM, along_row, across_rows};

}  // namespace slide::ops::SLIDE_ISA
