#include "ops/layering/layering_ops.h"

namespace slide::ops {

std::span<const Kernel* const> GaussianBlurOp::kernels() const { return {}; }
std::span<const Kernel* const> SobelOp::kernels() const { return {}; }

}  // namespace slide::ops
