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
  /// y[j] = the largest of a[2·j], a[2·j + 1], b[2·j] and b[2·j + 1], of those before `width`; NaN if there
  /// is one among them.
  void (*maxima_of_pairs)(const float* a, const float* b, std::size_t width, float* y);
  /// sum[i] += x[i]
  void (*add_to)(float* sum, const float* x, std::size_t count);
};

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const PoolRoutines* const> pool_routines();

}  // namespace slide::ops
