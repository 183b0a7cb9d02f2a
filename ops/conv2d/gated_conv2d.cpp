#include "ops/conv2d/gated_conv2d.h"

#include <memory>
#include <vector>

#include "ops/conv2d/conv2d_op.h"

namespace slide::ops {

Value gated_conv2d(Value x, Value weight, std::optional<Value> bias, const Conv2dParams& params) {
  std::vector<Value> inputs{x, weight};
  if (bias) inputs.push_back(*bias);
  Conv2dFusion fusion;
  fusion.gate = true;
  return x.graph().add(std::make_shared<Conv2dOp>(params, fusion), inputs);
}

}  // namespace slide::ops
