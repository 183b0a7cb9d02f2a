#pragma once

// The primitive layer of all fast kernels: vectors of W float32 lanes over the compilers' vector extensions,
// so that one kernel source gives every instruction-set level (cmake/SlideKernels.cmake compiles it once per
// level, with SLIDE_ISA and SLIDE_ISA_WIDTH defined).
//
// Rule for sources that are compiled per level. The linker keeps one copy of an inline function or template
// whose name is the same in several object files. If that copy comes from an AVX-512 object, the program dies
// on a CPU without AVX-512, even when it was called from baseline code. Therefore such a source
//   - defines everything, inline functions, templates and lambdas included, in namespace
//   slide::ops::SLIDE_ISA,
//   - works on raw pointers and sizes: no Tensor, std::span, std::vector, std::function, std::min, std::fma;
//     C functions (memcpy) and compiler builtins are fine,
//   - is given its work by an ordinary source, which does shapes, scratch memory and parallel_for, through a
//     table of function pointers (ops/simd/dispatch.h).
// A test reads the object files' symbols and fails if one of them breaks the rule.

#ifndef SLIDE_ISA
#error "ops/simd/simd.h is for sources listed with slide_add_kernels()"
#endif

#include <cstddef>
#include <cstdint>

#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

#define SLIDE_INLINE inline __attribute__((always_inline))

namespace slide::ops::SLIDE_ISA::simd {

/// W lanes of float32. Passing one to a function that is not inlined is slow, so all functions on it are
/// SLIDE_INLINE.
template <int W = SLIDE_ISA_WIDTH>
struct Vec {
  typedef float Native __attribute__((vector_size(W * 4)));
  typedef std::int32_t Bits __attribute__((vector_size(W * 4)));
  static constexpr int kWidth = W;
  Native v;
};

/// The truth of a comparison, lane by lane: all bits set, or none.
template <int W = SLIDE_ISA_WIDTH>
struct Mask {
  typename Vec<W>::Bits v;
};

/// The vector and the mask of the level a source is compiled for.
using Float = Vec<SLIDE_ISA_WIDTH>;
using FloatMask = Mask<SLIDE_ISA_WIDTH>;
inline constexpr int kWidth = SLIDE_ISA_WIDTH;

/// All lanes x.
template <int W = SLIDE_ISA_WIDTH>
SLIDE_INLINE Vec<W> broadcast(float x) {
  return {x - typename Vec<W>::Native{}};
}

template <int W = SLIDE_ISA_WIDTH>
SLIDE_INLINE Vec<W> zero() {
  return {typename Vec<W>::Native{}};
}

/// W floats from an address of any alignment.
template <int W = SLIDE_ISA_WIDTH>
SLIDE_INLINE Vec<W> load(const float* p) {
  Vec<W> r;
  __builtin_memcpy(&r.v, p, sizeof r.v);
  return r;
}

template <int W>
SLIDE_INLINE void store(float* p, Vec<W> x) {
  __builtin_memcpy(p, &x.v, sizeof x.v);
}

/// The first `count` < W lanes from memory, zeros in the others; nothing beyond p[count - 1] is read.
template <int W = SLIDE_ISA_WIDTH>
SLIDE_INLINE Vec<W> load_partial(const float* p, std::size_t count) {
#if defined(__AVX512F__)
  if constexpr (W == 16) {
    return {_mm512_maskz_loadu_ps(static_cast<__mmask16>((1u << count) - 1u), p)};
  }
#endif
  float lanes[W] = {};
  for (std::size_t i = 0; i < count; ++i) lanes[i] = p[i];
  return load<W>(lanes);
}

/// Stores the first `count` < W lanes; nothing beyond p[count - 1] is written.
template <int W>
SLIDE_INLINE void store_partial(float* p, Vec<W> x, std::size_t count) {
#if defined(__AVX512F__)
  if constexpr (W == 16) {
    _mm512_mask_storeu_ps(p, static_cast<__mmask16>((1u << count) - 1u), x.v);
    return;
  }
#endif
  float lanes[W];
  store(lanes, x);
  for (std::size_t i = 0; i < count; ++i) p[i] = lanes[i];
}

template <int W>
SLIDE_INLINE Vec<W> operator+(Vec<W> a, Vec<W> b) {
  return {a.v + b.v};
}
template <int W>
SLIDE_INLINE Vec<W> operator-(Vec<W> a, Vec<W> b) {
  return {a.v - b.v};
}
template <int W>
SLIDE_INLINE Vec<W> operator-(Vec<W> a) {
  return {-a.v};
}
template <int W>
SLIDE_INLINE Vec<W> operator*(Vec<W> a, Vec<W> b) {
  return {a.v * b.v};
}
template <int W>
SLIDE_INLINE Vec<W> operator/(Vec<W> a, Vec<W> b) {
  return {a.v / b.v};
}

/// a·b + c, rounded once wherever the level has fused multiply-add: AVX2 and above, AArch64. The SSE2
/// baseline has no such instruction; there the product is rounded first, which the kernels' error bounds
/// allow for.
template <int W>
SLIDE_INLINE Vec<W> fma(Vec<W> a, Vec<W> b, Vec<W> c) {
#if defined(__AVX512F__)
  if constexpr (W == 16) return {_mm512_fmadd_ps(a.v, b.v, c.v)};
#endif
#if defined(__FMA__)
  if constexpr (W == 8) return {_mm256_fmadd_ps(a.v, b.v, c.v)};
  if constexpr (W == 4) return {_mm_fmadd_ps(a.v, b.v, c.v)};
#elif defined(__aarch64__)
  if constexpr (W == 4) return {vfmaq_f32(c.v, a.v, b.v)};
#endif
  return {a.v * b.v + c.v};
}

template <int W>
SLIDE_INLINE Mask<W> operator<(Vec<W> a, Vec<W> b) {
  return {a.v < b.v};
}
template <int W>
SLIDE_INLINE Mask<W> operator<=(Vec<W> a, Vec<W> b) {
  return {a.v <= b.v};
}
template <int W>
SLIDE_INLINE Mask<W> operator==(Vec<W> a, Vec<W> b) {
  return {a.v == b.v};
}
template <int W>
SLIDE_INLINE Mask<W> is_nan(Vec<W> x) {
  return {x.v != x.v};
}
template <int W>
SLIDE_INLINE Mask<W> operator|(Mask<W> a, Mask<W> b) {
  return {a.v | b.v};
}
template <int W>
SLIDE_INLINE Mask<W> operator&(Mask<W> a, Mask<W> b) {
  return {a.v & b.v};
}

/// a where the mask is set, else b.
template <int W>
SLIDE_INLINE Vec<W> select(Mask<W> m, Vec<W> a, Vec<W> b) {
  return {m.v ? a.v : b.v};
}

/// a < b ? a : b, so b if either is NaN.
template <int W>
SLIDE_INLINE Vec<W> min(Vec<W> a, Vec<W> b) {
  return select(a < b, a, b);
}
/// b < a ? a : b, so b if either is NaN.
template <int W>
SLIDE_INLINE Vec<W> max(Vec<W> a, Vec<W> b) {
  return select(b < a, a, b);
}

/// The lanes' bits as integers, and back.
template <int W>
SLIDE_INLINE typename Vec<W>::Bits bits_of(Vec<W> x) {
  typename Vec<W>::Bits r;
  __builtin_memcpy(&r, &x.v, sizeof r);
  return r;
}
template <int W = SLIDE_ISA_WIDTH>
SLIDE_INLINE Vec<W> from_bits(typename Vec<W>::Bits bits) {
  Vec<W> r;
  __builtin_memcpy(&r.v, &bits, sizeof bits);
  return r;
}

template <int W>
SLIDE_INLINE Vec<W> abs(Vec<W> x) {
  return from_bits<W>(bits_of(x) & 0x7FFFFFFF);
}

/// |x| with the sign of `sign`; x must not be negative.
template <int W>
SLIDE_INLINE Vec<W> with_sign(Vec<W> x, Vec<W> sign) {
  return from_bits<W>(bits_of(x) | (bits_of(sign) & static_cast<std::int32_t>(0x80000000)));
}

/// Correctly rounded square root; NaN below 0.
template <int W>
SLIDE_INLINE Vec<W> sqrt(Vec<W> x) {
#if defined(__AVX512F__)
  if constexpr (W == 16)
    return {_mm512_maskz_sqrt_ps(static_cast<__mmask16>(0xFFFF), x.v)};  // GCC 12 warns of the plain one
#endif
#if defined(__AVX2__)
  if constexpr (W == 8) return {_mm256_sqrt_ps(x.v)};
#endif
#if defined(__x86_64__)
  if constexpr (W == 4) return {_mm_sqrt_ps(x.v)};
#elif defined(__aarch64__)
  if constexpr (W == 4) return {vsqrtq_f32(x.v)};
#endif
  Vec<W> r;
  for (int i = 0; i < W; ++i) r.v[i] = __builtin_sqrtf(x.v[i]);
  return r;
}

/// The sum of the lanes, added pairwise in a fixed tree: log2(W) roundings deep.
template <int W>
SLIDE_INLINE float sum_of_lanes(Vec<W> x) {
  float lanes[W];
  store(lanes, x);
  for (int half = W / 2; half > 0; half /= 2)
    for (int i = 0; i < half; ++i) lanes[i] += lanes[i + half];
  return lanes[0];
}

/// The largest lane; unspecified if one is NaN.
template <int W>
SLIDE_INLINE float max_of_lanes(Vec<W> x) {
  float lanes[W];
  store(lanes, x);
  for (int i = 1; i < W; ++i) lanes[0] = lanes[0] < lanes[i] ? lanes[i] : lanes[0];
  return lanes[0];
}

}  // namespace slide::ops::SLIDE_ISA::simd
