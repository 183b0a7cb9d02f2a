#pragma once

// Vectorised elementary functions with their errors in ULP of the exact result (of the smallest denormal
// below the normal range), over every float32 argument. NaN in gives NaN out. The bounds hold at every
// instruction-set level; they assume that denormals are not flushed. Over all arguments of magnitude 2^-30 to
// 128, with and without fused multiply-add, the largest errors against float64 are 0.81 (exp), 0.95
// (elu), 2.41 (sigmoid) and 2.50 (tanh).

#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA::simd {

namespace detail {

/// x = k·ln 2 + r with |r| <= ln(2)/2 (and a little), after Cody and Waite ("Software Manual for the
/// Elementary Functions", 1980): ln 2 in two parts, the first so short that k times it is exact. |x| <= 120.
template <int W>
struct Reduced {
  Vec<W> k;
  Vec<W> r;
};
template <int W>
SLIDE_INLINE Reduced<W> reduce(Vec<W> x) {
  const Vec<W> magic = broadcast<W>(0x1.8p23F);  // adding it rounds to an integer
  const Vec<W> k = fma(x, broadcast<W>(0x1.715476p0F), magic) - magic;
  const Vec<W> r = fma(k, broadcast<W>(-0x1.63p-1F), x);
  return {k, fma(k, broadcast<W>(0x1.bd0106p-13F), r)};
}

/// q(r) of e^r = 1 + r + r²·q(r) on the reduced range, minimax for the relative error of e^r: 0.06 · 2^-24.
template <int W>
SLIDE_INLINE Vec<W> exp_tail(Vec<W> r) {
  Vec<W> q = broadcast<W>(0x1.6a4154p-10F);
  q = fma(q, r, broadcast<W>(0x1.1239c6p-7F));
  q = fma(q, r, broadcast<W>(0x1.5558bcp-5F));
  q = fma(q, r, broadcast<W>(0x1.555492p-3F));
  return fma(q, r, broadcast<W>(0x1.fffffcp-2F));
}

/// 2^k for integral k in [-126, 127].
template <int W>
SLIDE_INLINE Vec<W> exp2_integer(Vec<W> k) {
  const auto biased = bits_of(k + broadcast<W>(0x1.8p23F + 127.0F));  // the integer in the low mantissa bits
  return from_bits<W>(biased << 23);
}

/// e^x of a reduced x as mantissa · high · low. The power of two is in two factors: k reaches from -173 to
/// 128, and a denormal result must be rounded once, at the end.
template <int W>
struct ExpParts {
  Vec<W> mantissa, high, low;
};
template <int W>
SLIDE_INLINE ExpParts<W> exp_parts(const Reduced<W>& s) {
  // 1 + r is rounded, and what was lost (exactly representable: Dekker's fast two-sum) joins the small terms.
  const Vec<W> one = broadcast<W>(1.0F);
  const Vec<W> sum = one + s.r;
  const Vec<W> lost = s.r - (sum - one);
  const Vec<W> half = fma(s.k, broadcast<W>(0.5F), broadcast<W>(0x1.8p23F)) - broadcast<W>(0x1.8p23F);
  return {sum + fma(exp_tail(s.r), s.r * s.r, lost), exp2_integer(half), exp2_integer(s.k - half)};
}

/// erfc(t / sqrt(2)) / 2 · e^(t²/2) for t in [0, 15], as r·p(1 - 7r) with r = 1 / (t + 3.5): the polynomial
/// is minimax for the relative error, which is 1.3 · 2^-24 with its coefficients rounded.
template <int W>
SLIDE_INLINE Vec<W> scaled_tail(Vec<W> t) {
  const Vec<W> r = broadcast<W>(1.0F) / (t + broadcast<W>(3.5F));
  const Vec<W> w = fma(r, broadcast<W>(-7.0F), broadcast<W>(1.0F));
  Vec<W> p = broadcast<W>(0x1.d043d8p-14F);
  p = fma(p, w, broadcast<W>(0x1.ba6458p-12F));
  p = fma(p, w, broadcast<W>(-0x1.037e38p-11F));
  p = fma(p, w, broadcast<W>(-0x1.a031c0p-9F));
  p = fma(p, w, broadcast<W>(0x1.a98868p-8F));
  p = fma(p, w, broadcast<W>(0x1.1d2fa4p-6F));
  p = fma(p, w, broadcast<W>(-0x1.db5a6ep-4F));
  p = fma(p, w, broadcast<W>(0x1.42fec8p-2F));
  p = fma(p, w, broadcast<W>(-0x1.219150p-1F));
  return r * fma(p, w, broadcast<W>(0x1.7d241ap-1F));
}

}  // namespace detail

/// e^x within 1 ULP. Infinity exactly where the rounded result overflows (x > 88.72), denormals below, 0 from
/// x < -103.98.
template <int W>
SLIDE_INLINE Vec<W> exp(Vec<W> x) {
  const Vec<W> low = broadcast<W>(-105.0F);
  const Vec<W> high = broadcast<W>(89.0F);
  Vec<W> c = select(x < low, low, x);  // comparisons that leave NaN in place
  c = select(high < c, high, c);
  const detail::ExpParts<W> e = detail::exp_parts(detail::reduce(c));
  return e.mantissa * e.high * e.low;
}

/// e^x - 1 for x <= 0 (a result that is not NaN for other x has no meaning), within 1 ULP; accurate near 0,
/// and -0 for -0.
template <int W>
SLIDE_INLINE Vec<W> expm1_negative(Vec<W> x) {
  const Vec<W> low = broadcast<W>(-18.0F);  // below it the result rounds to -1
  const Vec<W> c = select(x < low, low, x);
  const detail::Reduced<W> s = detail::reduce(c);
  const Vec<W> p = fma(detail::exp_tail(s.r), s.r * s.r, s.r);
  const Vec<W> power = detail::exp2_integer(s.k);
  const Vec<W> y = fma(power, p, power - broadcast<W>(1.0F));
  return select(x == zero<W>(), x, y);
}

/// x, or e^x - 1 where x < 0, within 1 ULP.
template <int W>
SLIDE_INLINE Vec<W> elu(Vec<W> x) {
  const Vec<W> zeros = zero<W>();
  return select(x < zeros, expm1_negative(select(x < zeros, x, zeros)), x);
}

/// 1 / (1 + e^-x) within 2.5 ULP, also where the result is denormal (x < -87.3); 0 from x < -103.98.
template <int W>
SLIDE_INLINE Vec<W> sigmoid(Vec<W> x) {
  const Vec<W> one = broadcast<W>(1.0F);
  const Vec<W> z = exp(-abs(x));
  return select(x < zero<W>(), z, one) / (one + z);
}

/// Hyperbolic tangent within 2.5 ULP, also near 0, as -t / (2 + t) with t = e^(-2|x|) - 1; odd to the last
/// bit.
template <int W>
SLIDE_INLINE Vec<W> tanh(Vec<W> x) {
  const Vec<W> t = expm1_negative(abs(x) * broadcast<W>(-2.0F));
  return with_sign(abs(t / (broadcast<W>(2.0F) + t)), x);
}

/// x / (1 + e^-x) within 4 ULP; -0 from x < -109 on.
template <int W>
SLIDE_INLINE Vec<W> silu(Vec<W> x) {
  const Vec<W> one = broadcast<W>(1.0F);
  const Vec<W> least = broadcast<W>(-120.0F);
  const Vec<W> size = -abs(x);
  const detail::ExpParts<W> e = detail::exp_parts(detail::reduce(select(size < least, least, size)));
  const Vec<W> divisor = one + e.mantissa * e.high * e.low;
  const Vec<W> below = select(x < least, least, x);
  return select(x < zero<W>(), below * e.mantissa / divisor * e.high * e.low, x / divisor);
}

/// x·(1 + erf(x / sqrt(2))) / 2 within 14 ULP: the tail x·erfc(-x / sqrt(2)) / 2 for x < 0, x minus it for
/// others. -0 from x < -14.5 on. The bound, relative to the result in u = 2^-24 (at most 1 ULP), to first
/// order, each rounding being half an ULP of what it rounds, and fma two of them; the sum is largest at 0:
///   4.04  r's two roundings, 1.45, times the condition of r·p(1 - 7r), 2.79 (1.2 at t = 15)
///   2.69  w's two, times |p'/p|
///   2.09  Horner's scheme
///   0.08  the polynomial (1.3 at t = 13.3, where all others add up to 8.3)
///   4.06  r·p, the mantissa of e^(-t²/2), both products with the tail
///   1.00  the subtraction from x
/// 13.96 in all, 11.4 with fused multiply-add; the largest of all arguments is 6.4 ULP.
template <int W>
SLIDE_INLINE Vec<W> gelu(Vec<W> x) {
  const Vec<W> most = broadcast<W>(15.0F);
  const Vec<W> t = select(most < abs(x), most, abs(x));
  // t² / 2 in two parts, the first exact: t's upper half squared.
  const Vec<W> upper = from_bits<W>(bits_of(t) & static_cast<std::int32_t>(0xFFFFF000));
  const Vec<W> half = broadcast<W>(-0.5F);
  detail::Reduced<W> s = detail::reduce(upper * upper * half);
  s.r = fma((t - upper) * half, t + upper, s.r);
  const detail::ExpParts<W> e = detail::exp_parts(s);
  const Vec<W> tail = detail::scaled_tail(t) * e.mantissa;
  const Vec<W> below = -t * tail * e.high * e.low;
  const Vec<W> above = x - x * (tail * e.high * e.low);
  const Vec<W> y = select(x < zero<W>(), below, above);
  return select(most < x, x, y);  // infinity, too
}

}  // namespace slide::ops::SLIDE_ISA::simd
