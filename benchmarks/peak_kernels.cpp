// Compiled once per instruction-set level. Each loop keeps enough independent sums in registers that the
// latency of its instruction does not show; an empty assembler statement makes the compiler believe that the
// sums are used in each turn.

#include <cstdint>

#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

#include "benchmarks/peak_routines.h"

namespace slide::peak::SLIDE_ISA {
namespace {

constexpr int kSums = SLIDE_ISA_WIDTH == 16 ? 20 : 10;  // of 32 and of 16 registers
constexpr int kLanes = SLIDE_ISA_WIDTH;

typedef float Floats __attribute__((vector_size(kLanes * 4)));
typedef float UnalignedFloats __attribute__((vector_size(kLanes * 4), aligned(4)));

#if defined(__x86_64__)
#define SLIDE_KEEP(v) __asm__ volatile("" : "+x"(v))
#if defined(__AVX512F__)
#undef SLIDE_KEEP
#define SLIDE_KEEP(v) __asm__ volatile("" : "+v"(v))
#endif
#elif defined(__aarch64__)
#define SLIDE_KEEP(v) __asm__ volatile("" : "+w"(v))
#else
#define SLIDE_KEEP(v) __asm__ volatile("" : "+m"(v))
#endif

inline __attribute__((always_inline)) Floats multiply_add(Floats a, Floats b, Floats c) {
#if defined(__AVX512F__)
  return _mm512_fmadd_ps(a, b, c);
#elif defined(__FMA__)
  return _mm256_fmadd_ps(a, b, c);
#elif defined(__aarch64__)
  return vfmaq_f32(c, a, b);
#else
  return c + a * b;
#endif
}

void fp32(std::int64_t n) {
  Floats a = Floats{} + 1.0F;
  Floats b = Floats{} + 0x1p-20F;
  SLIDE_KEEP(a);
  SLIDE_KEEP(b);
  Floats sums[kSums] = {};
  for (std::int64_t i = 0; i < n; ++i)
#pragma GCC unroll 20
    for (int j = 0; j < kSums; ++j) {
      sums[j] = multiply_add(a, b, sums[j]);
      SLIDE_KEEP(sums[j]);
    }
}

#if defined(__AVX512BF16__) && defined(__AVX512VNNI__)
void bf16(std::int64_t n) {
  __m512i bits = _mm512_set1_epi16(0x3f80);  // 1 in bfloat16
  SLIDE_KEEP(bits);
  const auto a = reinterpret_cast<__m512bh>(bits);
  __m512 sums[kSums] = {};
  for (std::int64_t i = 0; i < n; ++i)
#pragma GCC unroll 20
    for (int j = 0; j < kSums; ++j) {
      sums[j] = _mm512_dpbf16_ps(sums[j], a, a);
      SLIDE_KEEP(sums[j]);
    }
}

void int8(std::int64_t n) {
  __m512i a = _mm512_set1_epi8(1);
  SLIDE_KEEP(a);
  __m512i sums[kSums] = {};
  for (std::int64_t i = 0; i < n; ++i)
#pragma GCC unroll 20
    for (int j = 0; j < kSums; ++j) {
      sums[j] = _mm512_dpbusd_epi32(sums[j], a, a);
      SLIDE_KEEP(sums[j]);
    }
}
#endif

float read(const float* x, std::int64_t n) {
  Floats sums[8] = {};
  for (std::int64_t i = 0; i < n; i += 8 * kLanes)
#pragma GCC unroll 8
    for (int j = 0; j < 8; ++j) sums[j] += *reinterpret_cast<const UnalignedFloats*>(x + i + j * kLanes);
  Floats sum = {};
  for (const Floats& s : sums) sum += s;
  return sum[0];
}

void copy(const float* x, float* y, std::int64_t n) {
  for (std::int64_t i = 0; i < n; i += kLanes)
    *reinterpret_cast<UnalignedFloats*>(y + i) = *reinterpret_cast<const UnalignedFloats*>(x + i);
}

}  // namespace

const Routines kRoutines = {
    .fp32 = fp32,
    .fp32_operations = 2.0 * kSums * kLanes,
#if defined(__AVX512BF16__) && defined(__AVX512VNNI__)
    .bf16 = bf16,
    .bf16_operations = 4.0 * kSums * kLanes,
    .int8 = int8,
    .int8_operations = 8.0 * kSums * kLanes,
#else
    .bf16 = nullptr,
    .bf16_operations = 0,
    .int8 = nullptr,
    .int8_operations = 0,
#endif
    .read = read,
    .copy = copy,
};

}  // namespace slide::peak::SLIDE_ISA
