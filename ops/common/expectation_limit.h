#pragma once

#include "runtime/tensor.h"

namespace slide::ops {

/// A kernel whose RMS error grows faster than Op::error_scale() on some inputs, where
/// Kernel::expected_error(), which knows shapes only, does not hold.
class ExpectationLimit {
 public:
  virtual ~ExpectationLimit() = default;
  /// @param own    what Kernel::error_scale() wrote
  /// @param scale  the operator's
  [[nodiscard]] virtual bool expectation_holds(const Tensor& own, const Tensor& scale) const = 0;
};

}  // namespace slide::ops
