#pragma once

#include <cstddef>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// Windows along a row, for one instruction-set level: y[j] = f(x[j·stride], ..., x[j·stride + kernel - 1]).
struct PoolRoutines {
  using Windows = void (*)(const float* x, std::size_t kernel, std::size_t stride, float* y,
                           std::size_t count);
  Isa isa;
  Windows maxima;  ///< NaN if there is one in the window
  Windows sums;    ///< added from left to right
  /// sum[i] += x[i]
  void (*add_to)(float* sum, const float* x, std::size_t count);
};

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const PoolRoutines* const> pool_routines();

}  // namespace slide::ops
