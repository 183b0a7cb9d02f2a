// At stride 1 a vector holds the windows of neighbouring outputs, and tap k is an unaligned load k elements
// further on. Other strides go output by output for a fixed tap, which compilers vectorise with shuffles
// where the stride is a constant.

#include "ops/pool/pool_routines.h"
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
void windows(const float* x, std::size_t kernel, std::size_t stride, float* y, std::size_t count) {
  if (stride == 2) return strided<F>(x, kernel, 2, y, count);
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
