#pragma once

#include <cstdint>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// What is normalised: `count` numbers a line, `step` apart.
struct LayerNormLines {
  const float* x;
  const float* weight;
  const float* bias;
  double eps;
  std::int64_t count, step;
};

/// Layer normalisation of one line, and of lines that lie side by side, for one instruction-set level.
/// Statistics are sums in float64: of x first, then of (x - mean)².
struct LayerNormRoutines {
  static constexpr std::int64_t kColumns = 64;  ///< the most lines one call takes
  Isa isa;
  /// One line of neighbours (step 1).
  void (*row)(const LayerNormLines& lines, float* y);
  /// `columns` <= kColumns lines that start at neighbours.
  void (*columns)(const LayerNormLines& lines, float* y, std::int64_t columns);
};

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const LayerNormRoutines* const> layer_norm_routines();

}  // namespace slide::ops
