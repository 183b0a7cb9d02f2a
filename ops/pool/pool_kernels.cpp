// A vector holds the windows of neighbouring outputs. At stride 1, tap k is an unaligned load k elements
// further on; at stride 2 it is every second lane of two such loads, so that the first lanes of a pair give
// an even tap and the others the next. Other strides go output by output for a fixed tap. Maxima of 2×2 are
// taken of two rows at once.

#include "ops/pool/pool_routines.h"
#include "ops/simd/fetch_ahead.h"
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

SLIDE_INLINE Float larger_pairs(Float a, Float a_next, Float b, Float b_next) {
  const Float low = Larger::call(a, b);
  const Float high = Larger::call(a_next, b_next);
  return Larger::call(simd::even(low, high), simd::odd(low, high));
}

void maxima_of_pairs(const float* a, const float* b, std::size_t width, float* y) {
  const auto pairs = static_cast<std::int64_t>(width / 2);
  std::int64_t j = 0;
  for (; j + kWidth <= pairs; j += kWidth, a += 2 * kWidth, b += 2 * kWidth) {
    simd::fetch_ahead(a);
    simd::fetch_ahead(a + kWidth);
    simd::fetch_ahead(b);
    simd::fetch_ahead(b + kWidth);
    simd::own_ahead(y + j);
    simd::store(y + j,
                larger_pairs(simd::load(a), simd::load(a + kWidth), simd::load(b), simd::load(b + kWidth)));
  }
  if (const std::int64_t rest = 2 * (pairs - j); rest > 0) {
    const auto next = [&](const float* x) {
      return rest > kWidth ? simd::load_some(x + kWidth, rest - kWidth) : simd::zero();
    };
    simd::store_some(
        y + j, larger_pairs(simd::load_some(a, rest), next(a), simd::load_some(b, rest), next(b)), rest / 2);
    a += rest;
    b += rest;
  }
  if (width % 2 != 0) y[pairs] = Larger::call(*a, *b);
}

void add_to(float* sum, const float* x, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) sum[i] += x[i];
}

}  // namespace

extern const PoolRoutines pooling;
const PoolRoutines pooling{Isa::SLIDE_ISA_ENUM, windows<Larger>, windows<Sum>, maxima_of_pairs, add_to};

}  // namespace slide::ops::SLIDE_ISA
