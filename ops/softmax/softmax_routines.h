#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// Softmax over neighbouring numbers, and over columns of a matrix, for one instruction-set level.
struct SoftmaxRoutines {
  static constexpr std::size_t kColumns = 256;  ///< the most columns one call takes
  Isa isa;
  /// y = softmax of `count` neighbours.
  void (*row)(const float* x, float* y, std::size_t count);
  /// For each of `columns` <= kColumns neighbours the softmax of `count` elements that are `step` apart.
  void (*columns)(const float* x, float* y, std::size_t count, std::size_t step, std::size_t columns);
};

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const SoftmaxRoutines* const> softmax_routines();

}  // namespace slide::ops
