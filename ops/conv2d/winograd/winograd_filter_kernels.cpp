// Filters for Winograd convolutions: lanes are filters. A pair of points ±p shares the even and the odd half
// of its two rows of G. Vectors of float64 are the compilers' own, of any length: they make of one what the
// level has.

#include "ops/conv2d/winograd/winograd_filters.h"
#include "ops/conv2d/words.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

constexpr int kLanes = 8;
using Doubles [[gnu::vector_size(kLanes * sizeof(double))]] = double;
using Floats [[gnu::vector_size(kLanes * sizeof(float))]] = float;

SLIDE_INLINE void load(const float* taps, Doubles& x) {
#if defined(__AVX512F__)
  // The other form becomes five instructions, and of the unmasked one GCC 12 fears it to be uninitialised.
  x = _mm512_maskz_cvtps_pd(0xFF, _mm256_loadu_ps(taps));
#else
  Floats narrow;
  __builtin_memcpy(&narrow, taps, sizeof narrow);
  x = __builtin_convertvector(narrow, Doubles);
#endif
}

/// y[i] = G[i] · (x[0], x[1], x[2]).
template <int Pairs, typename Matrix, typename Vector>
SLIDE_INLINE void multiply(const Matrix& g, const Vector (&x)[3], Vector (&y)[2 * Pairs + 2]) {
  y[0] = g.zero * x[0];
  for (int k = 0; k < Pairs; ++k) {
    const Vector even = g.one[k] * x[0] + g.square[k] * x[2];
    const Vector odd = g.first[k] * x[1];
    y[2 * k + 1] = even + odd;
    y[2 * k + 2] = even - odd;
  }
  y[2 * Pairs + 1] = x[2];
}

/// kLanes filters, of which `count` are written.
template <int Pairs>
SLIDE_INLINE void transform_lanes(const WinogradFilterMatrix& g, const float* taps, std::int64_t stride,
                                  std::int64_t count, float* u, std::int64_t frequency_stride) {
  constexpr int kSide = 2 * Pairs + 2;
  Doubles columns[kSide][3];
  for (int v = 0; v < 3; ++v) {
    Doubles x[3], y[kSide];
    for (int k = 0; k < 3; ++k) load(taps + (3 * k + v) * stride, x[k]);
    multiply<Pairs>(g, x, y);
    for (int i = 0; i < kSide; ++i) columns[i][v] = y[i];
  }
  for (int i = 0; i < kSide; ++i) {
    Doubles y[kSide];
    multiply<Pairs>(g, columns[i], y);
    for (int j = 0; j < kSide; ++j, u += frequency_stride) {
      const Floats narrow = __builtin_convertvector(y[j], Floats);
      if (count == kLanes)
        __builtin_memcpy(u, &narrow, sizeof narrow);
      else
        __builtin_memcpy(u, &narrow, static_cast<std::size_t>(count) * sizeof(float));
    }
  }
}

template <int Pairs>
void transform(const WinogradFilterMatrix& filter_matrix, const float* taps, std::int64_t count, float* u,
               std::int64_t frequency_stride) {
  const WinogradFilterMatrix g = filter_matrix;  // stores cannot change it, as the compiler knows
  std::int64_t n = 0;
  for (; n + kLanes <= count; n += kLanes)
    transform_lanes<Pairs>(g, taps + n, count, kLanes, u + n, frequency_stride);
  if (n == count) return;
  float last[9 * kLanes] = {};
  for (int t = 0; t < 9; ++t)
    for (std::int64_t i = n; i < count; ++i) last[t * kLanes + i - n] = taps[t * count + i];
  transform_lanes<Pairs>(g, last, kLanes, count - n, u + n, frequency_stride);
}

/// WinogradFilterMatrix in float32.
template <int Pairs>
struct FloatMatrix {
  Float zero, one[Pairs], first[Pairs], square[Pairs];
};

SLIDE_INLINE Float low_half(Bits words) { return as_float(words << 16); }
SLIDE_INLINE Float high_half(Bits words) { return as_float(words & static_cast<std::int32_t>(0xFFFF0000)); }

template <int Pairs>
void transform_words(const WinogradFilterMatrix& filter_matrix, const float* taps, std::int64_t count,
                     float* u, std::int64_t frequency_stride) {
  constexpr int kSide = 2 * Pairs + 2;
  FloatMatrix<Pairs> g{simd::broadcast(static_cast<float>(filter_matrix.zero)), {}, {}, {}};
  for (int k = 0; k < Pairs; ++k) {
    g.one[k] = simd::broadcast(static_cast<float>(filter_matrix.one[k]));
    g.first[k] = simd::broadcast(static_cast<float>(filter_matrix.first[k]));
    g.square[k] = simd::broadcast(static_cast<float>(filter_matrix.square[k]));
  }
  for (std::int64_t n = 0; n < count; n += simd::kWidth) {
    Float columns[2][kSide][3];
    for (int v = 0; v < 3; ++v) {
      Float x[2][3];
      for (int k = 0; k < 3; ++k) {
        const Bits words = load_words(taps + (3 * k + v) * count + n);
        x[0][k] = low_half(words);
        x[1][k] = high_half(words);
      }
      for (int lane = 0; lane < 2; ++lane) {
        Float y[kSide];
        multiply<Pairs>(g, x[lane], y);
        for (int i = 0; i < kSide; ++i) columns[lane][i][v] = y[i];
      }
    }
    float* to = u + n;
    for (int i = 0; i < kSide; ++i) {
      Float y[2][kSide];
      for (int lane = 0; lane < 2; ++lane) multiply<Pairs>(g, columns[lane][i], y[lane]);
      for (int j = 0; j < kSide; ++j, to += frequency_stride) {
        const Float pair[2] = {y[0][j], y[1][j]};
        store_words(to, Bf16::word(0, 0, pair));
      }
    }
  }
}

}  // namespace

extern const WinogradFilterRoutines winograd_filters;
const WinogradFilterRoutines winograd_filters = {{transform<1>, transform<2>, transform<3>},
                                                 {transform_words<1>, transform_words<2>}};

}  // namespace slide::ops::SLIDE_ISA
