#include "ops/pool/pool_op.h"

namespace slide::ops {

std::span<const Kernel* const> PoolOp::kernels() const { return {}; }

}  // namespace slide::ops
namespace slide::ops {
std::span<const Kernel* const> AdaptiveAvgPoolOp::kernels() const { return {}; }
}  // namespace slide::ops
