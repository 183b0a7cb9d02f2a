// One loop over whole vectors and a partial vector at the end, the same arithmetic in both.

#include "ops/pointwise/pointwise_routines.h"
#include "ops/simd/fetch_ahead.h"
#include "ops/simd/math.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::broadcast;
using simd::Float;
using simd::kWidth;

// Comparisons are written so that NaN comes through.
struct Relu {
  static SLIDE_INLINE Float call(Float x, Float, Float) { return simd::max(simd::zero<>(), x); }
};
struct Relu6 {
  static SLIDE_INLINE Float call(Float x, Float, Float) {
    return simd::min(broadcast<>(6.0F), simd::max(simd::zero<>(), x));
  }
};
struct LeakyRelu {
  static SLIDE_INLINE Float call(Float x, Float slope, Float) {
    return select(x < simd::zero<>(), slope * x, x);
  }
};
struct Elu {
  static SLIDE_INLINE Float call(Float x, Float alpha, Float) {
    return select(x < simd::zero<>(), alpha * simd::elu(x), x);
  }
};
struct Sigmoid {
  static SLIDE_INLINE Float call(Float x, Float, Float) { return simd::sigmoid(x); }
};
struct Tanh {
  static SLIDE_INLINE Float call(Float x, Float, Float) { return simd::tanh(x); }
};
struct Silu {
  static SLIDE_INLINE Float call(Float x, Float, Float) { return simd::silu(x); }
};
struct Gelu {
  static SLIDE_INLINE Float call(Float x, Float, Float) { return simd::gelu(x); }
};
struct Exp {
  static SLIDE_INLINE Float call(Float x, Float, Float) { return simd::exp(x); }
};
struct Sqrt {
  static SLIDE_INLINE Float call(Float x, Float, Float) { return simd::sqrt(x); }
};
struct Abs {
  static SLIDE_INLINE Float call(Float x, Float, Float) { return simd::abs(x); }
};
struct Clip {
  static SLIDE_INLINE Float call(Float x, Float low, Float high) {
    return simd::min(high, simd::max(low, x));
  }
};
struct Affine {
  static SLIDE_INLINE Float call(Float x, Float scale, Float shift) { return fma(x, scale, shift); }
};
struct Greater {
  static SLIDE_INLINE Float call(Float x, Float threshold, Float) {
    return select(threshold < x, broadcast<>(1.0F), simd::zero<>());
  }
};

template <typename F>
void unary(const float* x, float* y, std::size_t count, float a, float b) {
  const Float va = broadcast<>(a);
  const Float vb = broadcast<>(b);
  std::size_t i = 0;
  for (; i + kWidth <= count; i += kWidth) {
    simd::fetch_ahead(x + i);
    simd::own_ahead(y + i);
    simd::store(y + i, F::call(simd::load(x + i), va, vb));
  }
  if (i < count) simd::store_partial(y + i, F::call(simd::load_partial(x + i, count - i), va, vb), count - i);
}

struct Add {
  static SLIDE_INLINE Float call(Float a, Float b) { return a + b; }
};
struct Sub {
  static SLIDE_INLINE Float call(Float a, Float b) { return a - b; }
};
struct Mul {
  static SLIDE_INLINE Float call(Float a, Float b) { return a * b; }
};
struct Div {
  static SLIDE_INLINE Float call(Float a, Float b) { return a / b; }
};
struct Minimum {
  static SLIDE_INLINE Float call(Float a, Float b) { return select(simd::is_nan(a) | (a < b), a, b); }
};
struct Maximum {
  static SLIDE_INLINE Float call(Float a, Float b) { return select(simd::is_nan(a) | (b < a), a, b); }
};

/// One of the two arrays: elements in a row, or one element again and again.
template <bool Steps>
struct Operand {
  const float* p;
  Float all;
  explicit SLIDE_INLINE Operand(const float* from) : p(from), all(broadcast<>(*from)) {}
  [[nodiscard]] SLIDE_INLINE Float load(std::size_t i) const {
    if (Steps) simd::fetch_ahead(p + i);
    return Steps ? simd::load(p + i) : all;
  }
  [[nodiscard]] SLIDE_INLINE Float load_partial(std::size_t i, std::size_t count) const {
    return Steps ? simd::load_partial(p + i, count) : all;
  }
};

template <typename F, bool StepsA, bool StepsB>
void binary_loop(const float* pa, const float* pb, float* y, std::size_t count) {
  const Operand<StepsA> a(pa);
  const Operand<StepsB> b(pb);
  std::size_t i = 0;
  for (; i + kWidth <= count; i += kWidth) {
    simd::own_ahead(y + i);
    simd::store(y + i, F::call(a.load(i), b.load(i)));
  }
  if (i < count)
    simd::store_partial(y + i, F::call(a.load_partial(i, count - i), b.load_partial(i, count - i)),
                        count - i);
}

template <typename F>
void binary(const float* a, std::size_t a_step, const float* b, std::size_t b_step, float* y,
            std::size_t count) {
  if (a_step != 0 && b_step != 0)
    binary_loop<F, true, true>(a, b, y, count);
  else if (a_step != 0)
    binary_loop<F, true, false>(a, b, y, count);
  else if (b_step != 0)
    binary_loop<F, false, true>(a, b, y, count);
  else
    binary_loop<F, false, false>(a, b, y, count);
}

}  // namespace

extern const PointwiseRoutines pointwise;
const PointwiseRoutines pointwise{
    Isa::SLIDE_ISA_ENUM,
    {unary<Relu>, unary<Relu6>, unary<LeakyRelu>, unary<Elu>, unary<Sigmoid>, unary<Tanh>, unary<Exp>,
     unary<Sqrt>, unary<Abs>, unary<Clip>, unary<Affine>, unary<Greater>, unary<Silu>, unary<Gelu>},
    {binary<Add>, binary<Sub>, binary<Mul>, binary<Div>, binary<Minimum>, binary<Maximum>}};

}  // namespace slide::ops::SLIDE_ISA
