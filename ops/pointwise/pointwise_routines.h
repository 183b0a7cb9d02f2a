#pragma once

#include <cstddef>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// The loops of the pointwise operators over arrays, for one instruction-set level.
struct PointwiseRoutines {
  /// y[i] = f(x[i]; a, b).
  using Unary = void (*)(const float* x, float* y, std::size_t count, float a, float b);
  /// y[i] = f(a[i · a_step], b[i · b_step]), steps 0 or 1.
  using Binary = void (*)(const float* a, std::size_t a_step, const float* b, std::size_t b_step, float* y,
                          std::size_t count);
  Isa isa;
  Unary unary[14];   ///< in the order of UnaryKind
  Binary binary[6];  ///< in the order of BinaryKind
};

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const PointwiseRoutines* const> pointwise_routines();

}  // namespace slide::ops
