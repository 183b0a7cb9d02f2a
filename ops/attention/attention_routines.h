#pragma once

#include <cstdint>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// The loops of contextual attention over rows of scores, for one instruction-set level.
struct AttentionRoutines {
  Isa isa;
  std::int64_t width;  ///< lanes of a vector

  /// y[j] = (x[0][j] + x[1][j] + ...) · scale[j], added in order; at least one x; scale may be null: 1.
  void (*sum)(std::span<const float* const> x, const float* scale, float* y, std::int64_t count);
  /// y[j] += factor · x[j].
  void (*add_scaled)(float factor, const float* x, float* y, std::int64_t count);
  /// y[j] = (y[j] · x[j]) · factor.
  void (*multiply)(float factor, const float* x, float* y, std::int64_t count);
  /// The largest element; count >= 1.
  float (*largest)(const float* x, std::int64_t count);
  /// x[j] = e^(x[j] - largest). Returns their sum: kSumBlock vectors at a time, lane by lane, then the lanes
  /// as a tree, then the blocks in order.
  float (*exponentials)(float largest, float* x, std::int64_t count);
};

/// Vectors summed before they are added to the total.
inline constexpr std::int64_t kSumBlock = 32;

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const AttentionRoutines* const> attention_routines();

}  // namespace slide::ops
