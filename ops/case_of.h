#pragma once

#include <span>

#include "ops/case_io.h"
#include "runtime/op.h"

namespace slide::ops {

/// The operator case of one call, the inverse of build_case(): the operator's name, its attributes as JSON
/// and the inputs under the operator's own input names. Tensors are shared, not copied; `source` is left
/// empty. Throws Error(kInternal) for an operator that has no case form.
[[nodiscard]] OperatorCase case_of(const Op& op, std::span<const Tensor> inputs, const Tensor& expected);

}  // namespace slide::ops
