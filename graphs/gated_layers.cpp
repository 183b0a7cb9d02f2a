#include "graphs/gated_layers.h"

#include <algorithm>
#include <vector>

#include "graphs/layers.h"
#include "ops/conv2d/gated_conv2d.h"
#include "ops/pointwise/pointwise.h"
#include "ops/tensor_shape/tensor_shape.h"
#include "runtime/error.h"

namespace slide::graphs {
namespace {

constexpr std::int64_t kMostChannels = 4096;

}  // namespace

Value gated_conv(Value x, std::string_view name, const GatedLayer& layer) {
  Graph& g = x.graph();
  Value y = x;
  {
    const auto module = g.scope(name);
    const auto scope = g.scope("conv");
    const std::int64_t filters = 2 * layer.channels;
    const Value weight = g.parameter("weight", {filters, x.shape()[1], layer.kernel, layer.kernel});
    const Value bias = g.parameter("bias", {filters});
    y = ops::gated_conv2d(x, weight, bias,
                          ops::Conv2dParams::same(layer.kernel, layer.stride, layer.dilation));
  }
  return tapped(name, y);
}

Value gated_conv_relu(Value x, std::string_view name, const GatedLayer& layer) {
  Value y = x;
  {
    const auto module = x.graph().scope(name);
    y = conv2d(x, "conv",
               {.filters = 2 * layer.channels,
                .kernel = layer.kernel,
                .stride = layer.stride,
                .dilation = layer.dilation});
    const Value features = ops::slice(y, 1, 0, layer.channels);
    const Value gate = ops::slice(y, 1, layer.channels, 2 * layer.channels);
    y = ops::mul(ops::relu(features), ops::sigmoid(gate));
  }
  return tapped(name, y);
}

Value plain_conv(Value x, std::string_view name, std::int64_t channels) {
  Value y = x;
  {
    const auto module = x.graph().scope(name);
    y = conv2d(x, "conv", {.filters = channels});
  }
  return tapped(name, y);
}

Value with_mask(Value masked, Value mask) {
  const Shape& shape = mask.shape();
  const std::vector<double> ones(static_cast<std::size_t>(shape.count()), 1.0);
  return ops::concat({masked, mask.graph().constant("ones", Tensor::from<double>(shape, ones)), mask}, 1);
}

std::optional<Shape> filter_shape(const WeightSource& weights, std::string_view name) {
  if (weights.names().empty()) return std::nullopt;
  const std::optional<Tensor> tensor = weights.find(name, {});
  if (!tensor)
    throw Error(ErrorKind::kBadWeights, weights.description() + ": " + std::string(name) + " is missing",
                "slide_convert --list FILE shows what a file holds");
  const Shape shape = tensor->shape();
  const auto in_range = [](std::int64_t extent) { return extent >= 1 && extent <= kMostChannels; };
  if (shape.rank() != 4 || !std::ranges::all_of(shape.extents(), in_range))
    throw Error(ErrorKind::kBadWeights, weights.description() + ": " + std::string(name) + " has shape " +
                                            shape.text() + ", four extents from 1 to " +
                                            std::to_string(kMostChannels) + " are needed");
  return shape;
}

}  // namespace slide::graphs
