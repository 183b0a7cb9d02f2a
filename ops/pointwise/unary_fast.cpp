#include "ops/pointwise/unary_op.h"

namespace slide::ops {

std::span<const Kernel* const> UnaryOp::kernels() const { return {}; }

}  // namespace slide::ops
