// Each lane keeps its own result; the lanes are joined at the end, in order, and the elements that do not
// fill a vector after them.

#include "ops/reduce/reduce_routines.h"
#include "ops/simd/fetch_ahead.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::Float;
using simd::kWidth;
typedef double Doubles __attribute__((vector_size(kWidth * 8)));

double sum_of_lanes(const Doubles& lanes) {
  double sum = 0;
  for (int i = 0; i < kWidth; ++i) sum += lanes[i];
  return sum;
}

/// The sum of x - centre, or of its squares; several vectors at once, since an addition waits for the one
/// before.
template <bool kSquares>
double sum_around(const float* x, std::size_t count, double centre) {
  constexpr std::size_t kChains = 4;
  Doubles lanes[kChains]{};
  std::size_t i = 0;
  for (; i + kChains * kWidth <= count; i += kChains * kWidth)
    for (std::size_t k = 0; k < kChains; ++k) {
      simd::fetch_ahead(x + i + k * kWidth);
      const Doubles d = __builtin_convertvector(simd::load(x + i + k * kWidth).v, Doubles) - centre;
      lanes[k] += kSquares ? d * d : d;
    }
  for (std::size_t k = 1; k < kChains; ++k) lanes[0] += lanes[k];
  double total = sum_of_lanes(lanes[0]);
  for (; i < count; ++i) {
    const double d = static_cast<double>(x[i]) - centre;
    total += kSquares ? d * d : d;
  }
  return total;
}

double sum(const float* x, std::size_t count) { return sum_around<false>(x, count, 0); }

// The better of what is kept and a new value; NaN is better than all and is never left again.
struct Smaller {
  static constexpr float kWorst = __builtin_inff();
  static SLIDE_INLINE Float call(Float kept, Float x) {
    return select((x < kept) | simd::is_nan(x), x, kept);
  }
  static SLIDE_INLINE float call(float kept, float x) { return x < kept || x != x ? x : kept; }
};
struct Larger {
  static constexpr float kWorst = -__builtin_inff();
  static SLIDE_INLINE Float call(Float kept, Float x) {
    return select((kept < x) | simd::is_nan(x), x, kept);
  }
  static SLIDE_INLINE float call(float kept, float x) { return kept < x || x != x ? x : kept; }
};

template <typename F>
float best(const float* x, std::size_t count) {
  Float lanes = simd::broadcast<>(F::kWorst);
  std::size_t i = 0;
  for (; i + kWidth <= count; i += kWidth) {
    simd::fetch_ahead(x + i);
    lanes = F::call(lanes, simd::load(x + i));
  }
  float kept = F::kWorst;
  for (int l = 0; l < kWidth; ++l) kept = F::call(kept, static_cast<float>(lanes.v[l]));
  for (; i < count; ++i) kept = F::call(kept, x[i]);
  return kept;
}

void add_to(double* sums, const float* x, std::size_t count) {
  std::size_t i = 0;
  for (; i + kWidth <= count; i += kWidth) {
    simd::fetch_ahead(x + i);
    Doubles kept;
    __builtin_memcpy(&kept, sums + i, sizeof kept);
    kept += __builtin_convertvector(simd::load(x + i).v, Doubles);
    __builtin_memcpy(sums + i, &kept, sizeof kept);
  }
  for (; i < count; ++i) sums[i] += static_cast<double>(x[i]);
}

template <typename F>
void best_to(float* kept, const float* x, std::size_t count) {
  std::size_t i = 0;
  for (; i + kWidth <= count; i += kWidth) {
    simd::fetch_ahead(x + i);
    simd::store(kept + i, F::call(simd::load(kept + i), simd::load(x + i)));
  }
  for (; i < count; ++i) kept[i] = F::call(kept[i], x[i]);
}

}  // namespace

extern const ReduceRoutines reductions;
const ReduceRoutines reductions{Isa::SLIDE_ISA_ENUM, sum,    sum_around<true>, best<Smaller>,
                                best<Larger>,        add_to, best_to<Smaller>, best_to<Larger>};

}  // namespace slide::ops::SLIDE_ISA
