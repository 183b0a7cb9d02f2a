// Both filters work on rows: a vector holds neighbouring columns, and all rows that one output row needs are
// read once. Gaussian taps are added from the outermost, smallest one inwards.

#include "ops/layering/cone_kernel.h"
#include "ops/layering/layering_routines.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::broadcast;
using simd::Float;
using simd::kWidth;

#if defined(__FMA__) || defined(__aarch64__)
constexpr bool kFused = true;
#else
constexpr bool kFused = false;
#endif

/// Vectors, then single elements, with the same arithmetic but for the fused operations.
template <int W>
SLIDE_INLINE simd::Vec<W> symmetric(const float* const* centre, const float* taps, std::ptrdiff_t radius,
                                    std::size_t j) {
  simd::Vec<W> sum = simd::zero<W>();
  for (std::ptrdiff_t k = radius; k > 0; --k)
    sum = fma(broadcast<W>(taps[k]), simd::load<W>(centre[-k] + j) + simd::load<W>(centre[k] + j), sum);
  return fma(broadcast<W>(taps[0]), simd::load<W>(centre[0] + j), sum);
}

void symmetric_sum(const float* const* centre, const float* taps, std::size_t radius, float* y,
                   std::size_t count) {
  const auto r = static_cast<std::ptrdiff_t>(radius);
  std::size_t j = 0;
  for (; j + kWidth <= count; j += kWidth) simd::store(y + j, symmetric<kWidth>(centre, taps, r, j));
  for (; j < count; ++j) {
    float sum = 0;
    for (std::ptrdiff_t k = r; k > 0; --k) sum += taps[k] * (centre[-k][j] + centre[k][j]);
    y[j] = sum + taps[0] * centre[0][j];
  }
}

void sobel_row(const float* above, const float* middle, const float* below, float* gx, float* gy,
               std::size_t count) {
  for (std::size_t j = 0; j < count; ++j) {
    const float across =
        (above[j + 2] - above[j]) + 2.0F * (middle[j + 2] - middle[j]) + (below[j + 2] - below[j]);
    const float down =
        (below[j] - above[j]) + 2.0F * (below[j + 1] - above[j + 1]) + (below[j + 2] - above[j + 2]);
    gx[j] = across * 0.125F;
    gy[j] = down * 0.125F;
  }
}

}  // namespace

extern const LayeringRoutines layering;
const LayeringRoutines layering{Isa::SLIDE_ISA_ENUM, symmetric_sum, sobel_row, kFused,
                                kConeLanes,          cone_lines};

}  // namespace slide::ops::SLIDE_ISA
