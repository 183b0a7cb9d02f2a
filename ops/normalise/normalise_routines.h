#pragma once

#include <cstdint>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// What a channel of a normalised tensor becomes: max(least, scale·(x - mean) + shift + residual). The mean
/// is subtracted first: x and mean may be far larger than their difference.
struct NormalisedRow {
  const float* x;
  const float* residual;  ///< may be null
  float mean, scale, shift;
  float least;  ///< -infinity if there is none
};

/// The loops of normalisation, for one instruction-set level.
struct NormaliseRoutines {
  Isa isa;
  /// Writes `count` numbers to y, past the caches if told so: non_temporal_fence()
  /// (ops/common/non_temporal.h) is the caller's.
  void (*finish)(const NormalisedRow& row, float* y, std::int64_t count, bool non_temporal);
};

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const NormaliseRoutines* const> normalise_routines();

}  // namespace slide::ops
