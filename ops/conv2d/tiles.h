#pragma once

// Registers of a matrix each, for sources compiled per level: those of AMX (Intel, Software Developer's
// Manual, volume 2: TILELOADD, TDPBF16PS, TDPBSUD), and the same in plain code, for tests where there is
// none. A tile has 16 rows of 64 bytes; eight of them are T0 ... T7.

#include <cmath>
#include <cstdint>

#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

constexpr std::int64_t kTileHeight = 16;
constexpr std::int64_t kTileWords = 16;  ///< of a row

#if defined(SLIDE_TILES_EMULATED)

/// TDPBF16PS and TDPBSUD as the manual defines them.
class Tiles {
 public:
  static void configure() {}
  static void release() {}
  template <int T>
  void zero() {
    for (std::uint32_t& word : words_[T]) word = 0;
  }
  template <int T>
  void load(const float* from, std::int64_t stride) {
    for (std::int64_t i = 0; i < kTileHeight; ++i)
      __builtin_memcpy(words_[T] + i * kTileWords, from + i * stride, kTileWords * sizeof(float));
  }
  template <int T>
  void store(float* to, std::int64_t stride) const {
    for (std::int64_t i = 0; i < kTileHeight; ++i)
      __builtin_memcpy(to + i * stride, words_[T] + i * kTileWords, kTileWords * sizeof(float));
  }
  /// The products of first and of second numbers are summed apart, from zero, each with one rounding to the
  /// nearest, ties to even; then both sums are added, and the result to C. Denormals count as zeros.
  template <int C, int A, int B>
  void add_bf16() {
    for (std::int64_t m = 0; m < kTileHeight; ++m)
      for (std::int64_t n = 0; n < kTileWords; ++n) {
        float sums[2] = {0, 0};
        for (std::int64_t k = 0; k < kTileWords; ++k) {
          const std::uint32_t a = words_[A][m * kTileWords + k], b = words_[B][k * kTileWords + n];
          sums[0] = flushed(std::fma(flushed(float_of(a << 16)), flushed(float_of(b << 16)), sums[0]));
          sums[1] = flushed(std::fma(flushed(float_of(a & kHigh)), flushed(float_of(b & kHigh)), sums[1]));
        }
        std::uint32_t& c = words_[C][m * kTileWords + n];
        const float sum = flushed(flushed(float_of(c)) + flushed(sums[0] + sums[1]));
        __builtin_memcpy(&c, &sum, sizeof c);
      }
  }
  /// A signed, B unsigned.
  template <int C, int A, int B>
  void add_int8() {
    for (std::int64_t m = 0; m < kTileHeight; ++m)
      for (std::int64_t n = 0; n < kTileWords; ++n)
        for (std::int64_t k = 0; k < kTileWords; ++k)
          for (unsigned byte = 0; byte < 32; byte += 8) {
            const auto a = static_cast<std::int8_t>(words_[A][m * kTileWords + k] >> byte & 0xFFU);
            const auto b = static_cast<std::int32_t>(words_[B][k * kTileWords + n] >> byte & 0xFFU);
            words_[C][m * kTileWords + n] += static_cast<std::uint32_t>(a * b);
          }
  }

 private:
  static constexpr std::uint32_t kHigh = 0xFFFF0000U;
  static float float_of(std::uint32_t bits) {
    float value;
    __builtin_memcpy(&value, &bits, sizeof value);
    return value;
  }
  static float flushed(float x) { return std::fabs(x) < 0x1p-126F ? std::copysign(0.0F, x) : x; }
  std::uint32_t words_[8][kTileHeight * kTileWords];
};

#else

/// The processor's. Every access says that it reads or writes memory: compilers order them with others then.
class Tiles {
 public:
  /// All eight whole, on the calling thread. What tiles held is lost.
  static void configure() {
    struct alignas(64) {
      std::uint8_t palette, start_row, reserved[14];
      std::uint16_t row_bytes[16];
      std::uint8_t rows[16];
    } shape{1, 0, {}, {64, 64, 64, 64, 64, 64, 64, 64}, {16, 16, 16, 16, 16, 16, 16, 16}};
    __asm__ volatile("ldtilecfg %0" : : "m"(shape) : "memory");
  }
  /// Where none is in use, the operating system need not save them.
  static void release() { __asm__ volatile("tilerelease" : : : "memory"); }
  template <int T>
  SLIDE_INLINE void zero() {
    __asm__ volatile("tilezero %%tmm%c0" : : "i"(T));
  }
  template <int T>
  SLIDE_INLINE void load(const float* from, std::int64_t stride) {
    __asm__ volatile("tileloadd (%0,%1,1), %%tmm%c2" : : "r"(from), "r"(stride * 4), "i"(T) : "memory");
  }
  template <int T>
  SLIDE_INLINE void store(float* to, std::int64_t stride) const {
    __asm__ volatile("tilestored %%tmm%c2, (%0,%1,1)" : : "r"(to), "r"(stride * 4), "i"(T) : "memory");
  }
  template <int C, int A, int B>
  SLIDE_INLINE void add_bf16() {
    __asm__ volatile("tdpbf16ps %%tmm%c2, %%tmm%c1, %%tmm%c0" : : "i"(C), "i"(A), "i"(B));
  }
  template <int C, int A, int B>
  SLIDE_INLINE void add_int8() {
    __asm__ volatile("tdpbsud %%tmm%c2, %%tmm%c1, %%tmm%c0" : : "i"(C), "i"(A), "i"(B));
  }
};

#endif

}  // namespace
}  // namespace slide::ops::SLIDE_ISA
