#pragma once

// The ends of rows: whole vectors as long as there are, then a partial one. See ops/simd/simd.h for the
// rules.

#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA::simd {

/// The first `count` numbers, zeros in the other lanes; all from kWidth on.
SLIDE_INLINE Float load_some(const float* x, std::int64_t count) {
  return count >= kWidth ? load(x) : load_partial(x, static_cast<std::size_t>(count));
}

/// The first `count` lanes; all from kWidth on.
SLIDE_INLINE void store_some(float* y, Float value, std::int64_t count) {
  if (count >= kWidth)
    store(y, value);
  else
    store_partial(y, value, static_cast<std::size_t>(count));
}

}  // namespace slide::ops::SLIDE_ISA::simd
