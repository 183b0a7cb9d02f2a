#include "graphs/layers.h"

#include <algorithm>
#include <vector>

#include "ops/conv2d/conv2d.h"
#include "ops/normalise/normalise.h"
#include "ops/pointwise/pointwise.h"
#include "ops/tensor_shape/tensor_shape.h"
#include "runtime/error.h"

namespace slide::graphs {
namespace {

Value convolve(Value x, std::string_view name, const ConvLayer& layer, const ops::Conv2dParams& params) {
  Graph& g = x.graph();
  const auto scope = g.scope(name);
  const Value weight =
      g.parameter("weight", {layer.filters, x.shape()[1] / layer.groups, layer.kernel, layer.kernel});
  std::optional<Value> bias;
  if (layer.bias) bias = g.parameter("bias", {layer.filters});
  return ops::conv2d(x, weight, bias, params);
}

}  // namespace

Value conv2d(Value x, std::string_view name, const ConvLayer& layer) {
  return convolve(x, name, layer,
                  ops::Conv2dParams::same(layer.kernel, layer.stride, layer.dilation, layer.groups));
}

Value conv2d_tf_same(Value x, std::string_view name, const ConvLayer& layer) {
  ops::Conv2dParams params;
  params.stride = {layer.stride, layer.stride};
  params.dilation = {layer.dilation, layer.dilation};
  params.groups = layer.groups;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const std::int64_t size = x.shape().extents()[2 + axis];
    const std::int64_t output = (size + layer.stride - 1) / layer.stride;
    const std::int64_t covered = (output - 1) * layer.stride + layer.dilation * (layer.kernel - 1) + 1;
    const std::int64_t total = std::max<std::int64_t>(covered - size, 0);
    params.padding[axis] = total / 2;
    params.padding[axis + 2] = total - total / 2;
  }
  return convolve(x, name, layer, params);
}

Value batch_norm(Value x, std::string_view name, double eps) {
  Graph& g = x.graph();
  const auto scope = g.scope(name);
  const Shape channels{x.shape()[1]};
  const Value weight = g.parameter("weight", channels);
  const Value bias = g.parameter("bias", channels);
  const Value mean = g.parameter("running_mean", channels);
  const Value var = g.parameter("running_var", channels);
  return ops::batch_norm(x, weight, bias, mean, var, eps);
}

Value group_norm(Value x, std::string_view name, std::int64_t groups, double eps) {
  Graph& g = x.graph();
  const auto scope = g.scope(name);
  const Shape channels{x.shape()[1]};
  const Value weight = g.parameter("weight", channels);
  const Value bias = g.parameter("bias", channels);
  return ops::group_norm(x, groups, weight, bias, eps);
}

Value layer_norm(Value x, std::string_view name, double eps) {
  Graph& g = x.graph();
  const auto scope = g.scope(name);
  const Shape channels{x.shape()[1]};
  const Value weight = g.parameter("weight", channels);
  const Value bias = g.parameter("bias", channels);
  return ops::layer_norm(x, 1, weight, bias, eps);
}

Value linear(Value tokens, std::string_view name, std::int64_t features) {
  Graph& g = tokens.graph();
  const auto scope = g.scope(name);
  const std::int64_t channels = tokens.shape()[1];
  const Value weight = g.parameter("weight", {features, channels});
  const Value bias = g.parameter("bias", {features});
  return ops::conv2d(tokens, ops::reshape(weight, {features, channels, 1, 1}), bias, {});
}

Value scaled_linear(Value tokens, std::string_view name, std::int64_t features, std::string_view gamma) {
  Graph& g = tokens.graph();
  const std::int64_t channels = tokens.shape()[1];
  const Value factor = g.parameter(gamma, {features});
  const auto scope = g.scope(name);
  const Value weight = g.parameter("weight", {features, channels});
  const Value bias = g.parameter("bias", {features});
  const Value scaled = ops::mul(weight, ops::reshape(factor, {features, 1}));
  return ops::conv2d(tokens, ops::reshape(scaled, {features, channels, 1, 1}), ops::mul(bias, factor), {});
}

Value conv_transpose2d(Value x, std::string_view name, std::int64_t filters, std::int64_t factor) {
  Graph& g = x.graph();
  const auto scope = g.scope(name);
  const Shape s = x.shape();  // a copy: the graph grows
  const Value weight = g.parameter("weight", {s[1], filters, factor, factor});
  const Value bias = g.parameter("bias", {filters});
  // y[f, i·factor + a, j·factor + b] = bias[f] + sum over c of weight[c, f, a, b] · x[c, i, j]
  const std::int64_t pixels = factor * factor;
  const Value rows = ops::reshape(ops::permute(weight, {1, 2, 3, 0}), {filters * pixels, s[1], 1, 1});
  const Value ones = g.constant(
      "ones", Tensor::from<double>({1, pixels}, std::vector<double>(static_cast<std::size_t>(pixels), 1)));
  const Value shifts = ops::reshape(ops::mul(ops::reshape(bias, {filters, 1}), ones), {filters * pixels});
  Value y = ops::conv2d(x, rows, shifts, {});
  y = ops::reshape(y, {filters, factor, factor, s[2], s[3]});
  y = ops::permute(y, {0, 3, 1, 4, 2});
  return ops::reshape(y, {1, filters, s[2] * factor, s[3] * factor});
}

void require_image(std::string_view network, Value x, std::int64_t channels, std::int64_t multiple) {
  const Shape& s = x.shape();
  if (s.rank() == 4 && s[0] == 1 && s[1] == channels && s[2] > 0 && s[3] > 0 && s[2] % multiple == 0 &&
      s[3] % multiple == 0)
    return;
  std::string wanted = "1x" + std::to_string(channels) + "xHxW";
  if (multiple > 1) wanted += " with H and W multiples of " + std::to_string(multiple);
  throw Error(ErrorKind::kUsage,
              std::string(network) + ": an input has shape " + s.text() + ", " + wanted + " is needed");
}

Value tapped(std::string_view name, Value x) {
  x.graph().tap(name, x);
  return x;
}

}  // namespace slide::graphs
