// One loop over whole vectors and a partial vector at the end, the same arithmetic in both.

#include "ops/simd/array_math.h"
#include "ops/simd/math.h"

namespace slide::ops::SLIDE_ISA {
namespace {

template <simd::Float (*F)(simd::Float)>
void map(const float* x, float* y, std::size_t count) {
  constexpr std::size_t kWidth = simd::kWidth;
  std::size_t i = 0;
  for (; i + kWidth <= count; i += kWidth) simd::store(y + i, F(simd::load(x + i)));
  if (i < count) simd::store_partial(y + i, F(simd::load_partial(x + i, count - i)), count - i);
}

}  // namespace

extern const ArrayMath array_math;
const ArrayMath array_math{Isa::SLIDE_ISA_ENUM, map<simd::exp>,  map<simd::elu>, map<simd::sigmoid>,
                           map<simd::tanh>,     map<simd::silu>, map<simd::gelu>};

}  // namespace slide::ops::SLIDE_ISA
