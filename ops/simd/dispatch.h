#pragma once

#include "runtime/cpu.h"

/// SLIDE_EACH_ISA(X) expands to X(level, enumerator) for every instruction-set level this build has kernels
/// for, best first. With it an ordinary source declares and lists what a per-level source defines:
///
///   struct Routines { void (*scale)(float* x, std::size_t n); };           // in a header both include
///
///   #define SLIDE_DECLARE(level, enumerator) namespace level { extern const Routines routines; }
///   SLIDE_EACH_ISA(SLIDE_DECLARE)                                          // in namespace slide::ops
///   #undef SLIDE_DECLARE
///
/// and `slide::ops::avx2::routines` is what the file compiled with SLIDE_ISA = avx2 defines as
/// `slide::ops::SLIDE_ISA::routines`.
///
/// SLIDE_EACH_WORD_ISA(X) is the same for the sources of slide_add_word_kernels(), SLIDE_EACH_BF16_ISA(X),
/// perhaps of no level, for those of slide_add_bf16_kernels().
#if defined(SLIDE_HAVE_AVX512BF16)
#define SLIDE_EACH_WORD_ISA(X)           \
  X(amx, slide::Isa::kAmx)               \
  X(avx512bf16, slide::Isa::kAvx512Bf16) \
  X(avx512vnni, slide::Isa::kAvx512Vnni) \
  X(avx512, slide::Isa::kAvx512)         \
  X(avxvnni, slide::Isa::kAvxVnni) X(avx2, slide::Isa::kAvx2) X(baseline, slide::Isa::kBaseline)
#define SLIDE_EACH_ISA(X)                \
  X(avx512bf16, slide::Isa::kAvx512Bf16) \
  X(avx512, slide::Isa::kAvx512) X(avx2, slide::Isa::kAvx2) X(baseline, slide::Isa::kBaseline)
#elif defined(SLIDE_HAVE_NEON)
#define SLIDE_EACH_WORD_ISA(X)       \
  X(neonbf16, slide::Isa::kNeonBf16) \
  X(neoni8mm, slide::Isa::kNeonI8mm) \
  X(neondot, slide::Isa::kNeonDot)   \
  X(neon, slide::Isa::kNeon) X(baseline, slide::Isa::kBaseline)
#define SLIDE_EACH_ISA(X) X(neon, slide::Isa::kNeon) X(baseline, slide::Isa::kBaseline)
#else
#define SLIDE_EACH_ISA(X) X(baseline, slide::Isa::kBaseline)
#endif
#if defined(SLIDE_HAVE_AVX512BF16)
#define SLIDE_EACH_BF16_ISA(X) X(amx, slide::Isa::kAmx) X(avx512bf16, slide::Isa::kAvx512Bf16)
#else
#define SLIDE_EACH_BF16_ISA(X)
#endif
#if !defined(SLIDE_EACH_WORD_ISA)
#define SLIDE_EACH_WORD_ISA(X) SLIDE_EACH_ISA(X)
#endif
