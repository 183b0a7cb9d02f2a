#pragma once

#include <optional>

#include "ops/pointwise/pointwise_routines.h"
#include "ops/pointwise/unary_op.h"

namespace slide::ops {

/// A unary function made ready for arrays: the routine of a level and its attributes in float32.
struct UnaryRow {
  PointwiseRoutines::Unary function;
  float a, b;

  void operator()(const float* x, float* y, std::size_t count) const { function(x, y, count, a, b); }
};

[[nodiscard]] UnaryRow unary_row(const UnaryOp& op, const PointwiseRoutines& routines);

/// The routines of the level, which must be one of this build's.
[[nodiscard]] const PointwiseRoutines& pointwise_routines_of(Isa isa);

/// The largest slope of a function that may be fused as activation; nothing if it may not.
[[nodiscard]] std::optional<double> activation_slope(const UnaryOp& op);

/// c of |y - y64| <= c·u·scale for UnaryRow, scale being UnaryOp::error_scale().
[[nodiscard]] double unary_error_factor(const UnaryOp& op);

}  // namespace slide::ops
