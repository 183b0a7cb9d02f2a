#pragma once

#include <cstdint>

#if defined(__x86_64__)
#include <emmintrin.h>
#endif

namespace slide::ops {

/// From so many bytes on a result's stores may bypass the caches (ops/simd/non_temporal.h): it would push
/// what is still needed out of the second-level cache. Winograd convolutions that do so take 2 to 7 % off the
/// time of MiDaS small, slide_depth and U²-NetP (one thread); from 2^23 bytes on only, half of that.
inline constexpr std::int64_t kNonTemporalBytes = 1 << 18;

/// To be called between such stores and whatever tells another thread that they are done.
inline void non_temporal_fence() {
#if defined(__x86_64__)
  _mm_sfence();
#endif
}

}  // namespace slide::ops
