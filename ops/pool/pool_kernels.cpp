// A vector holds the windows of neighbouring outputs. At stride 1, tap k is an unaligned load k elements
// further on; at stride 2 it is every second lane of two such loads, so that the first lanes of a pair give
// an even tap and the others the next. Other strides go output by output for a fixed tap.

#include "ops/pool/pool_routines.h"
#include "ops/simd/lanes.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::Float;
using simd::kWidth;

struct Larger {
  static SLIDE_INLINE Float call(Float kept, Float x) {
    return select((kept < x) | simd::is_nan(x), x, kept);
  }
  static SLIDE_INLINE float call(float kept, float x) { return kept < x || x != x ? x : kept; }
};
struct Sum {
  static SLIDE_INLINE Float call(Float kept, Float x) { return kept + x; }
  static SLIDE_INLINE float call(float kept, float x) { return kept + x; }
};

template <typename F>
SLIDE_INLINE void strided(const float* x, std::size_t kernel, std::size_t stride, float* y,
                          std::size_t count) {
  for (std::size_t j = 0; j < count; ++j) y[j] = x[j * stride];
  for (std::size_t k = 1; k < kernel; ++k)
    for (std::size_t j = 0; j < count; ++j) y[j] = F::call(y[j], x[j * stride + k]);
}

template <typename F>
SLIDE_INLINE void every_second(const float* x, std::size_t kernel, float* y, std::size_t count) {
  std::size_t j = 0;
  // The last pair of loads may reach one element beyond the last window: it stays out of whole vectors.
  for (; j + kWidth < count; j += kWidth) {
    const float* from = x + 2 * j;
    Float kept = simd::even(simd::load(from), simd::load(from + kWidth));
    for (std::size_t k = 1; k < kernel; ++k) {
      const float* pair = from + k / 2 * 2;
      const Float low = simd::load(pair), high = simd::load(pair + kWidth);
      kept = F::call(kept, k % 2 == 0 ? simd::even(low, high) : simd::odd(low, high));
    }
    simd::store(y + j, kept);
  }
  strided<F>(x + 2 * j, kernel, 2, y + j, count - j);
}

template <typename F>
void windows(const float* x, std::size_t kernel, std::size_t stride, float* y, std::size_t count) {
  if (stride == 2) return every_second<F>(x, kernel, y, count);
  if (stride != 1) return strided<F>(x, kernel, stride, y, count);
  std::size_t j = 0;
  for (; j + kWidth <= count; j += kWidth) {
    Float kept = simd::load(x + j);
    for (std::size_t k = 1; k < kernel; ++k) kept = F::call(kept, simd::load(x + j + k));
    simd::store(y + j, kept);
  }
  strided<F>(x + j, kernel, 1, y + j, count - j);
}

void add_to(float* sum, const float* x, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) sum[i] += x[i];
}

}  // namespace

extern const PoolRoutines pooling;
const PoolRoutines pooling{Isa::SLIDE_ISA_ENUM, windows<Larger>, windows<Sum>, add_to};

}  // namespace slide::ops::SLIDE_ISA
