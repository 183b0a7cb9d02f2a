#pragma once

// What a 32-bit word of a product holds (one float32, two bfloat16, four 8-bit integers) and how words are
// made and multiplied, for sources compiled per level.

#include "ops/conv2d/conv2d_routines.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::Float;

using Bits = simd::Float::Bits;
/// The same bits as 16-bit integers.
typedef std::int16_t Halves __attribute__((vector_size(sizeof(Bits))));

SLIDE_INLINE Bits broadcast_word(const float* word) {
  std::int32_t bits;
  __builtin_memcpy(&bits, word, sizeof bits);
  return Bits{} + bits;
}
SLIDE_INLINE Bits load_words(const float* words) {
  Bits bits;
  __builtin_memcpy(&bits, words, sizeof bits);
  return bits;
}
SLIDE_INLINE void store_words(float* to, Bits bits) { __builtin_memcpy(to, &bits, sizeof bits); }
SLIDE_INLINE Float as_float(Bits bits) { return simd::from_bits<SLIDE_ISA_WIDTH>(bits); }

/// Sums in float32.
struct FloatSums {
  static constexpr bool kSquares = false, kSplitsPairs = false;
  using Sum = Float;
  static SLIDE_INLINE Sum load(const float* sums) { return simd::load(sums); }
  static SLIDE_INLINE Sum start(const float* word) { return simd::broadcast(*word); }
  static SLIDE_INLINE Sum add(Sum a, Sum b) { return a + b; }
  static SLIDE_INLINE void store(float* sums, Sum sum) { simd::store(sums, sum); }
  static SLIDE_INLINE Float result(const WordProduct&, int, Sum sum) { return sum; }
};

/// One float32.
struct Fp32 : FloatSums {
  static constexpr int kLanes = 1;
  static SLIDE_INLINE Sum step(Bits a, Bits b, Sum sum) { return simd::fma(as_float(a), as_float(b), sum); }
  static SLIDE_INLINE Bits word(float, float, const Float* x) { return simd::bits_of(x[0]); }
};

/// Two bfloat16: the first in the low half.
struct Bf16 : FloatSums {
  static constexpr int kLanes = 2;
#if defined(__ARM_FEATURE_BF16_VECTOR_ARITHMETIC)
  static constexpr bool kSquares = true;
  static SLIDE_INLINE Bits square(Bits columns, Bits rows, Bits sums) {
    bfloat16x8_t left, right;
    float32x4_t total;
    __builtin_memcpy(&left, &columns, sizeof left);
    __builtin_memcpy(&right, &rows, sizeof right);
    __builtin_memcpy(&total, &sums, sizeof total);
    total = vbfmmlaq_f32(total, left, right);
    __builtin_memcpy(&sums, &total, sizeof sums);
    return sums;
  }
  static SLIDE_INLINE Sum of_bits(Bits sums) { return as_float(sums); }
#endif
  static SLIDE_INLINE Sum step(Bits a, Bits b, Sum sum) {
#if defined(__AVX512BF16__)
    __m512bh left, right;
    __builtin_memcpy(&left, &a, sizeof left);
    __builtin_memcpy(&right, &b, sizeof right);
    return {_mm512_dpbf16_ps(sum.v, left, right)};
#else
    constexpr auto kHigh = static_cast<std::int32_t>(0xFFFF0000);
    const Sum low = simd::fma(as_float(a << 16), as_float(b << 16), sum);
    return simd::fma(as_float(a & kHigh), as_float(b & kHigh), low);
#endif
  }
  /// To the nearest, ties to even, in the high half; NaN stays NaN.
  static SLIDE_INLINE Bits rounded(Float x) {
    const Bits bits = simd::bits_of(x);
    const Bits nearest = bits + 0x7FFF + (bits >> 16 & 1);
    const Bits quiet = bits | 0x00400000;
    return simd::is_nan(x).v ? quiet : nearest;
  }
  static SLIDE_INLINE Bits word(float, float, const Float* x) {
#if defined(__AVX512BF16__)
    // The low half has the first channel's sixteen numbers, the high half the second's.
    const __m512bh halves = _mm512_cvtne2ps_pbh(x[1].v, x[0].v);
    __m512i bits;
    __builtin_memcpy(&bits, &halves, sizeof bits);
    const __m512i pairs = _mm512_set_epi16(31, 15, 30, 14, 29, 13, 28, 12, 27, 11, 26, 10, 25, 9, 24, 8, 23,
                                           7, 22, 6, 21, 5, 20, 4, 19, 3, 18, 2, 17, 1, 16, 0);
    bits = _mm512_permutexvar_epi16(pairs, bits);
    Bits words;
    __builtin_memcpy(&words, &bits, sizeof words);
    return words;
#else
    constexpr auto kHigh = static_cast<std::int32_t>(0xFFFF0000);
    return (rounded(x[0]) >> 16 & 0xFFFF) | (rounded(x[1]) & kHigh);
#endif
  }
};

#if defined(__AVX2__) && !defined(__AVX512VNNI__) && !defined(__AVXVNNI__)
#define SLIDE_SPLITS_PAIRS 1
#endif

#if defined(__x86_64__)
/// For each pair of adjacent 16-bit integers the sum of their products.
SLIDE_INLINE Bits add_pairs(Halves a, Halves b) {
#if defined(__AVX512BW__)
  using Native = __m512i;
#elif defined(__AVX2__)
  using Native = __m256i;
#else
  using Native = __m128i;
#endif
  Native left, right;
  __builtin_memcpy(&left, &a, sizeof left);
  __builtin_memcpy(&right, &b, sizeof right);
#if defined(__AVX512BW__)
  const Native products = _mm512_madd_epi16(left, right);
#elif defined(__AVX2__)
  const Native products = _mm256_madd_epi16(left, right);
#else
  const Native products = _mm_madd_epi16(left, right);
#endif
  Bits sums;
  __builtin_memcpy(&sums, &products, sizeof sums);
  return sums;
}
#endif

#if defined(SLIDE_SPLITS_PAIRS)
/// For each four bytes the sum of the products, b's unsigned, a's signed. Those of pairs saturate at 16 bits: a's
/// pairs are of limited sums.
SLIDE_INLINE Bits add_fours(Bits b, Bits a) {
#if defined(__AVX512BW__)
  __m512i left, right;
#else
  __m256i left, right;
#endif
  __builtin_memcpy(&left, &b, sizeof left);
  __builtin_memcpy(&right, &a, sizeof right);
#if defined(__AVX512BW__)
  const __m512i sums = _mm512_madd_epi16(_mm512_maddubs_epi16(left, right), _mm512_set1_epi16(1));
#else
  const __m256i sums = _mm256_madd_epi16(_mm256_maddubs_epi16(left, right), _mm256_set1_epi16(1));
#endif
  Bits bits;
  __builtin_memcpy(&bits, &sums, sizeof bits);
  return bits;
}
#endif

/// Four integers: b unsigned (less kByteOffset), a signed; sums are int32.
struct Int8 {
  static constexpr int kLanes = 4;
#if defined(__ARM_FEATURE_MATMUL_INT8)
  static constexpr bool kSquares = true;
#else
  static constexpr bool kSquares = false;
#endif
#if defined(SLIDE_SPLITS_PAIRS)
  static constexpr bool kSplitsPairs = true;
#else
  static constexpr bool kSplitsPairs = false;
#endif
#if defined(__ARM_FEATURE_DOTPROD) && !defined(__ARM_FEATURE_MATMUL_INT8)
  static constexpr std::uint32_t kByteOffset = 128;
#else
  static constexpr std::uint32_t kByteOffset = 0;
#endif
  using Sum = Bits;
  static SLIDE_INLINE Sum load(const float* sums) { return load_words(sums); }
  static SLIDE_INLINE Sum start(const float* word) { return broadcast_word(word); }
  static SLIDE_INLINE Sum add(Sum a, Sum b) { return a + b; }
  static SLIDE_INLINE void store(float* sums, Sum sum) { store_words(sums, sum); }
  static SLIDE_INLINE Float result(const WordProduct& p, int row, Sum sum) {
    const Float value = {__builtin_convertvector(sum, Float::Native)};
    return simd::fma(value, simd::broadcast(p.step[row]), simd::broadcast(p.bias[row]));
  }
  static SLIDE_INLINE Sum step(Bits a, Bits b, Sum sum) {
#if defined(__AVX512VNNI__)
    __m512i left, right, total;
    __builtin_memcpy(&left, &a, sizeof left);
    __builtin_memcpy(&right, &b, sizeof right);
    __builtin_memcpy(&total, &sum, sizeof total);
    total = _mm512_dpbusd_epi32(total, right, left);
    __builtin_memcpy(&sum, &total, sizeof sum);
    return sum;
#elif defined(__AVXVNNI__)
    __m256i left, right, total;
    __builtin_memcpy(&left, &a, sizeof left);
    __builtin_memcpy(&right, &b, sizeof right);
    __builtin_memcpy(&total, &sum, sizeof total);
    total = _mm256_dpbusd_avx_epi32(total, right, left);
    __builtin_memcpy(&sum, &total, sizeof sum);
    return sum;
#elif defined(SLIDE_SPLITS_PAIRS)
    return sum + add_fours(b, a);
#elif defined(__ARM_FEATURE_DOTPROD)
    int8x16_t left, right;
    __builtin_memcpy(&left, &a, sizeof left);
    __builtin_memcpy(&right, &b, sizeof right);
    return vdotq_s32(sum, right, left);
#else
    return wide_step(a, b, sum);
#endif
  }
#if defined(__ARM_FEATURE_MATMUL_INT8)
  static SLIDE_INLINE Bits square(Bits columns, Bits rows, Bits sums) {
    uint8x16_t left;
    int8x16_t right;
    __builtin_memcpy(&left, &columns, sizeof left);
    __builtin_memcpy(&right, &rows, sizeof right);
    return vusmmlaq_s32(sums, left, right);
  }
  static SLIDE_INLINE Sum of_bits(Bits sums) { return sums; }
#endif
  /// Of any a, where there is no instruction for it.
  static SLIDE_INLINE Sum wide_step(Bits a, Bits b, Sum sum) {
#if defined(__x86_64__)
    // Products of bytes and their sums in pairs would overflow 16 bits (vpmaddubsw saturates): bytes become
    // 16-bit integers, even ones and odd ones, whose products are added in pairs as 32 bits.
    Halves left, right;
    __builtin_memcpy(&left, &a, sizeof left);
    __builtin_memcpy(&right, &b, sizeof right);
    return sum + add_pairs(left << 8 >> 8, right & 0xFF) + add_pairs(left >> 8, (right >> 8) & 0xFF);
#else
    for (int lane = 0; lane < 4; ++lane) sum += (a << (24 - 8 * lane) >> 24) * (b >> 8 * lane & 0xFF);
    return sum;
#endif
  }
  /// Conversion and packing saturate: only what would overflow the conversion is cut before.
  static SLIDE_INLINE Bits word(float zero, float inverse_step, const Float* x) {
    Float scaled[4];
    for (int lane = 0; lane < 4; ++lane)
      scaled[lane] = simd::min(simd::fma(x[lane], simd::broadcast(inverse_step), simd::broadcast(zero)),
                               simd::broadcast(255.0F));
    Bits word{};
#if defined(__AVX512BW__)
    const __m512i ab = _mm512_packs_epi32(_mm512_maskz_cvtps_epi32(0xFFFF, scaled[0].v),
                                          _mm512_maskz_cvtps_epi32(0xFFFF, scaled[1].v));
    const __m512i cd = _mm512_packs_epi32(_mm512_maskz_cvtps_epi32(0xFFFF, scaled[2].v),
                                          _mm512_maskz_cvtps_epi32(0xFFFF, scaled[3].v));
    const __m512i order = _mm512_maskz_broadcast_i32x4(
        0xFFFF, _mm_setr_epi8(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15));
    const __m512i bytes = _mm512_shuffle_epi8(_mm512_packus_epi16(ab, cd), order);
    __builtin_memcpy(&word, &bytes, sizeof word);
#elif defined(__AVX2__)
    const __m256i ab = _mm256_packs_epi32(_mm256_cvtps_epi32(scaled[0].v), _mm256_cvtps_epi32(scaled[1].v));
    const __m256i cd = _mm256_packs_epi32(_mm256_cvtps_epi32(scaled[2].v), _mm256_cvtps_epi32(scaled[3].v));
    const __m256i order =
        _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15));
    const __m256i bytes = _mm256_shuffle_epi8(_mm256_packus_epi16(ab, cd), order);
    __builtin_memcpy(&word, &bytes, sizeof word);
#elif defined(__aarch64__)
    uint32x4_t bytes[4];
    for (int lane = 0; lane < 4; ++lane) bytes[lane] = vcvtnq_u32_f32(scaled[lane].v);  // saturates at 0
    bytes[0] = vsliq_n_u32(bytes[0], bytes[1], 8);
    bytes[0] = vsliq_n_u32(bytes[0], bytes[2], 16);
    bytes[0] = vsliq_n_u32(bytes[0], bytes[3], 24);
    __builtin_memcpy(&word, bytes, sizeof word);
#else
    // Half is added because conversion cuts off.
    for (int lane = 0; lane < 4; ++lane)
      word |= __builtin_convertvector(
                  simd::max(simd::min(scaled[lane] + simd::broadcast(0.5F), simd::broadcast(255.0F)),
                            simd::zero())
                      .v,
                  Bits)
              << 8 * lane;
#endif
    return word ^ static_cast<std::int32_t>(kByteOffset * 0x01010101U);
  }
};

/// The same of any a at every level.
struct Int8Wide : Int8 {
  static constexpr bool kSplitsPairs = false;
  static SLIDE_INLINE Sum step(Bits a, Bits b, Sum sum) { return wide_step(a, b, sum); }
};

}  // namespace
}  // namespace slide::ops::SLIDE_ISA
