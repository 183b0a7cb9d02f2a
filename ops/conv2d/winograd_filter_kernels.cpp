// Filters for Winograd convolutions: lanes are filters. A pair of points ±p shares the even and the odd half
// of its two rows of G. The loops over lanes have a constant length, so that compilers make vectors of them.

#include "ops/conv2d/winograd_filters.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

constexpr int kLanes = 8;

/// y[i] = G[i] · (a, b, c).
template <int Pairs>
SLIDE_INLINE void multiply(const WinogradFilterMatrix& g, const double* a, const double* b, const double* c,
                           double (&y)[2 * Pairs + 2][kLanes]) {
  for (int n = 0; n < kLanes; ++n) y[0][n] = g.zero * a[n];
  for (int k = 0; k < Pairs; ++k)
    for (int n = 0; n < kLanes; ++n) {
      const double even = g.one[k] * a[n] + g.square[k] * c[n];
      const double odd = g.first[k] * b[n];
      y[2 * k + 1][n] = even + odd;
      y[2 * k + 2][n] = even - odd;
    }
  for (int n = 0; n < kLanes; ++n) y[2 * Pairs + 1][n] = c[n];
}

/// kLanes filters, of which `count` are written.
template <int Pairs>
SLIDE_INLINE void transform_lanes(const WinogradFilterMatrix& g, const double* taps, std::int64_t stride,
                                  std::int64_t count, float* u, std::int64_t frequency_stride) {
  constexpr int kSide = 2 * Pairs + 2;
  double columns[3][kSide][kLanes];
  for (int v = 0; v < 3; ++v)
    multiply<Pairs>(g, taps + v * stride, taps + (3 + v) * stride, taps + (6 + v) * stride, columns[v]);
  for (int i = 0; i < kSide; ++i) {
    double row[kSide][kLanes];
    multiply<Pairs>(g, columns[0][i], columns[1][i], columns[2][i], row);
    for (int j = 0; j < kSide; ++j, u += frequency_stride) {
      if (count == kLanes)
        for (int n = 0; n < kLanes; ++n) u[n] = static_cast<float>(row[j][n]);
      else
        for (int n = 0; n < count; ++n) u[n] = static_cast<float>(row[j][n]);
    }
  }
}

template <int Pairs>
void transform(const WinogradFilterMatrix& g, const double* taps, std::int64_t count, float* u,
               std::int64_t frequency_stride) {
  std::int64_t n = 0;
  for (; n + kLanes <= count; n += kLanes)
    transform_lanes<Pairs>(g, taps + n, count, kLanes, u + n, frequency_stride);
  if (n == count) return;
  double last[9 * kLanes] = {};
  for (int t = 0; t < 9; ++t)
    for (std::int64_t i = n; i < count; ++i) last[t * kLanes + i - n] = taps[t * count + i];
  transform_lanes<Pairs>(g, last, kLanes, count - n, u + n, frequency_stride);
}

}  // namespace

extern const WinogradFilters winograd_filters_of[3];
const WinogradFilters winograd_filters_of[3] = {transform<1>, transform<2>, transform<3>};

}  // namespace slide::ops::SLIDE_ISA
