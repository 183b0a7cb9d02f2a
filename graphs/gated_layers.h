#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "runtime/graph.h"
#include "runtime/weights.h"

namespace slide::graphs {

/// The layers of the gated-convolution inpainting networks (Yu et al., ICCV 2019); parameters
/// `name`.conv.weight and `name`.conv.bias, as in nipponjo/deepfillv2-pytorch. Each is tapped under its name.
struct GatedLayer {
  std::int64_t channels;  ///< that come out; the convolution has twice as many filters
  std::int64_t kernel = 3;
  std::int64_t stride = 1;
  std::int64_t dilation = 1;
};

/// elu(first half) · sigmoid(second half) of a convolution.
Value gated_conv(Value x, std::string_view name, const GatedLayer& layer);

/// relu(first half) · sigmoid(second half).
Value gated_conv_relu(Value x, std::string_view name, const GatedLayer& layer);

/// The convolution alone, not gated: an output layer.
Value plain_conv(Value x, std::string_view name, std::int64_t channels);

/// cat(masked, ones, mask): what the first stage of these networks sees.
/// @param masked  1×C×H×W in [-1,1], zero in the hole
/// @param mask    1×1×H×W, 1 inside the hole
Value with_mask(Value masked, Value mask);

/// The shape of a rank-4 tensor of a weight source; nothing if the source makes its tensors up. Throws
/// Error(kBadWeights) if the source has names but not this one, if its rank is not 4, or if an extent is not
/// in [1, 4096], beyond which no network of this kind goes.
std::optional<Shape> filter_shape(const WeightSource& weights, std::string_view name);

}  // namespace slide::graphs
