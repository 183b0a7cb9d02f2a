#pragma once

#include <optional>

#include "ops/conv2d/conv2d.h"

namespace slide::ops {

/// Gated convolution (Yu et al., "Free-Form Image Inpainting with Gated Convolution", ICCV 2019, eq. 2) in
/// DeepFillv2's form: a convolution with 2C filters, of whose channels the first half a and the second half g give
///   y = elu(a) · sigmoid(g),  C channels.
/// Parameters as conv2d(); weight has 2C filters. Throws Error(kInternal) if the number of filters is odd.
Value gated_conv2d(Value x, Value weight, std::optional<Value> bias, const Conv2dParams& params);

}  // namespace slide::ops
