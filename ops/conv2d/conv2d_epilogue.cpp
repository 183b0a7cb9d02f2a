#include <algorithm>

#include "ops/conv2d/conv2d_method.h"
#include "ops/pointwise/binary_op.h"
#include "ops/pointwise/unary_row.h"

namespace slide::ops {

bool only_cuts(const UnaryOp& activation) noexcept {
  const UnaryKind kind = activation.kind();
  return kind == UnaryKind::kRelu || kind == UnaryKind::kRelu6 || kind == UnaryKind::kClip;
}

Conv2dEpilogue::Conv2dEpilogue(const Conv2dFusion& fusion, Isa isa, bool clamps)
    : residual_last_(fusion.residual_last) {
  const PointwiseRoutines& routines = pointwise_routines_of(isa);
  add_ = routines.binary[static_cast<std::size_t>(BinaryKind::kAdd)];
  if (!fusion.activation) return;
  const UnaryRow row = unary_row(*fusion.activation, routines);
  const bool right_after = !fusion.gate && (!fusion.residual || fusion.residual_last);
  if (clamps && right_after && only_cuts(*fusion.activation)) {
    const UnaryKind kind = fusion.activation->kind();
    low_ = kind == UnaryKind::kClip ? row.a : 0;
    if (kind != UnaryKind::kRelu) high_ = kind == UnaryKind::kClip ? row.b : 6;
    return;
  }
  function_ = row.function;
  a_ = row.a;
  b_ = row.b;
}

void Conv2dEpilogue::finish(float* sums, const float* residual, float* y, std::int64_t count) const {
  const auto n = static_cast<std::size_t>(count);
  if (residual_last_ && residual != nullptr) {
    if (function_ != nullptr) function_(sums, sums, n, a_, b_);
    return add_(sums, 1, residual, 1, y, n);
  }
  if (residual != nullptr) add_(sums, 1, residual, 1, function_ != nullptr ? sums : y, n);
  if (function_ != nullptr)
    function_(sums, y, n, a_, b_);
  else if (residual == nullptr && y != sums)
    std::copy_n(sums, n, y);
}

}  // namespace slide::ops
