#pragma once

// Memory asked for before it is needed. See ops/simd/simd.h for the rules.

#include <cstdint>

#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA::simd {

/// Numbers from where a loop through memory is to what it asks for: two of the pages of 4 KiB at whose ends
/// the processor itself stops looking ahead, only to begin again late. Loops that did not ask waited for
/// memory half of their time.
inline constexpr std::int64_t kAhead = 2048;

/// Whoever reads on from x in order calls it for each vector. What lies kAhead further need not exist.
SLIDE_INLINE void fetch_ahead(const float* x) { __builtin_prefetch(x + kAhead); }
/// The same for who writes on from y.
SLIDE_INLINE void own_ahead(float* y) { __builtin_prefetch(y + kAhead, 1); }

}  // namespace slide::ops::SLIDE_ISA::simd
