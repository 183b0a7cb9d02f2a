// A vector holds the windows of neighbouring outputs. At stride 1, tap k is an unaligned load k elements
// further on; at stride 2 it is every second lane of two such loads, so that the first lanes of a pair give
// an even tap and the others the next. Other strides go output by output for a fixed tap.

#include "ops/pool/pool_routines.h"
#include "ops/simd/lanes.h"
#include "ops/simd/partial.h"
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

/// A vector of windows at stride 2; `load` gives kWidth elements from an offset on.
template <typename F, typename Load>
SLIDE_INLINE Float every_second(std::size_t kernel, const Load& load) {
  Float kept = simd::even(load(0), load(kWidth));
  for (std::size_t k = 1; k < kernel; ++k) {
    const auto pair = static_cast<std::int64_t>(k / 2 * 2);
    const Float low = load(pair), high = load(pair + kWidth);
    kept = F::call(kept, k % 2 == 0 ? simd::even(low, high) : simd::odd(low, high));
  }
  return kept;
}

template <typename F>
SLIDE_INLINE void rows_of_every_second(const float* x, std::size_t kernel, float* y, std::size_t count) {
  std::size_t j = 0;
  // The last pair of loads may reach one element beyond the last window: it stays out of whole vectors.
  for (; j + kWidth < count; j += kWidth, x += 2 * kWidth)
    simd::store(y + j, every_second<F>(kernel, [x](std::int64_t at) { return simd::load(x + at); }));
  const auto rest = static_cast<std::int64_t>(2 * (count - j) + kernel) - 2;
  const auto load = [x, rest](std::int64_t at) {
    return rest > at ? simd::load_some(x + at, rest - at) : simd::zero();
  };
  simd::store_some(y + j, every_second<F>(kernel, load), static_cast<std::int64_t>(count - j));
}

template <typename F>
void windows(const float* x, std::size_t kernel, std::size_t stride, float* y, std::size_t count) {
  if (stride == 2) return rows_of_every_second<F>(x, kernel, y, count);
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
