#include "graphs/unet.h"

#include <string_view>

#include "graphs/layers.h"
#include "ops/pointwise/pointwise.h"
#include "ops/resize/resize.h"
#include "ops/tensor_shape/tensor_shape.h"

namespace slide::graphs {
namespace {

constexpr std::int64_t kWidth = 16;  // channels at half the size

Value layer(Value x, std::string_view name, const ConvLayer& convolution) {
  return tapped(name, ops::relu(conv2d(x, name, convolution)));
}

/// Of a tensor of half the size, enlarged, and what is joined to it.
Value joining_layer(Value half, Value other, std::string_view name, std::int64_t channels) {
  return layer(ops::concat({ops::upsample_bilinear(half), other}, 1), name, {channels});
}

}  // namespace

Value small_unet(Value x, std::int64_t eighth, std::int64_t last) {
  const Value half = layer(layer(x, "conv1", {kWidth, 5, 2}), "conv2", {kWidth});
  const Value quarter = layer(layer(half, "conv3", {2 * kWidth, 3, 2}), "conv4", {2 * kWidth});
  Value y = layer(quarter, "conv5", {eighth, 3, 2});
  y = layer(y, "conv6", {eighth});
  y = layer(y, "conv7", {eighth, 3, 1, 2});
  y = layer(y, "conv8", {eighth, 3, 1, 4});
  y = layer(y, "conv9", {eighth, 3, 1, 8});
  y = joining_layer(y, quarter, "conv10", 2 * kWidth);
  y = joining_layer(y, half, "conv11", last);
  y = joining_layer(y, x, "conv12", last);
  return conv2d(y, "conv13", {1});
}

Value moved_by_log_odds(Value p, Value change) {
  const Value other = ops::mul(ops::affine(p, -1, 1), ops::exp(ops::affine(change, -1, 0)));
  return ops::div(p, ops::add(p, other));
}

}  // namespace slide::graphs
