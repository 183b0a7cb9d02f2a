#include "ops/layering/layering_ops.h"

namespace slide::ops {

std::span<const Kernel* const> ConeDilationOp::kernels() const { return {}; }

}  // namespace slide::ops
