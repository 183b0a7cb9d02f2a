#pragma once

// Stores that bypass the caches, for results too large to be found there again: lines that are written whole
// need not be read first. Other threads see them after non_temporal_fence(), ops/common/non_temporal.h. See
// ops/simd/simd.h for the rules.

#include <cstdint>

#include "ops/simd/partial.h"

namespace slide::ops::SLIDE_ISA::simd {

/// As store_some(); whole and aligned vectors bypass the caches, and stores that follow each other should
/// fill lines.
SLIDE_INLINE void store_non_temporal(float* y, Float value, std::int64_t count) {
#if defined(__x86_64__)
  if (count >= kWidth && reinterpret_cast<std::uintptr_t>(y) % sizeof value == 0) {
#if defined(__AVX512F__)
    _mm512_stream_ps(y, value.v);
#elif defined(__AVX__)
    _mm256_stream_ps(y, value.v);
#else
    _mm_stream_ps(y, value.v);
#endif
    return;
  }
#endif
  store_some(y, value, count);
}

}  // namespace slide::ops::SLIDE_ISA::simd
