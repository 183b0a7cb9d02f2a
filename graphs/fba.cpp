#include "graphs/fba.h"

#include <cmath>
#include <string>
#include <vector>

#include "graphs/layers.h"
#include "ops/conv2d/conv2d.h"
#include "ops/normalise/normalise.h"
#include "ops/pointwise/pointwise.h"
#include "ops/pool/pool.h"
#include "ops/reduce/reduce.h"
#include "ops/resize/resize.h"
#include "ops/tensor_shape/tensor_shape.h"

namespace slide::graphs {
namespace {

constexpr double kStandardiseEps = 1e-5;
constexpr double kLeak = 0.01;
constexpr std::int64_t kGroups = 32;

/// The layers of layers_WS.py under one configuration.
class Layers {
 public:
  explicit Layers(const FbaConfig& config) : standardise_(config.standardise_weights) {}

  Value conv(Value x, std::string_view name, const ConvLayer& layer) const {
    Graph& g = x.graph();
    const auto scope = g.scope(name);
    Value weight = g.parameter("weight", {layer.filters, x.shape()[1], layer.kernel, layer.kernel});
    if (standardise_) weight = ops::weight_standardise(weight, kStandardiseEps);
    std::optional<Value> bias;
    if (layer.bias) bias = g.parameter("bias", {layer.filters});
    return ops::conv2d(x, weight, bias, ops::Conv2dParams::same(layer.kernel, layer.stride, layer.dilation));
  }

 private:
  bool standardise_;
};

Value norm(Value x, std::string_view name) { return group_norm(x, name, kGroups); }

/// The convolutions' strides and dilations of a ResNet layer after the encoder was dilated.
struct Stage {
  std::int64_t planes;
  int blocks;
  std::int64_t stride = 1;          // of the first block
  std::int64_t first_dilation = 1;  // of the first block's 3×3
  std::int64_t dilation = 1;        // of the others'
};

Value bottleneck(const Layers& layers, Value x, const Stage& s, bool first) {
  const std::int64_t channels = 4 * s.planes;
  const std::int64_t stride = first ? s.stride : 1;
  const std::int64_t dilation = first ? s.first_dilation : s.dilation;
  Value y = layers.conv(x, "conv1", {.filters = s.planes, .kernel = 1, .bias = false});
  y = ops::relu(norm(y, "bn1"));
  y = layers.conv(y, "conv2", {.filters = s.planes, .stride = stride, .dilation = dilation, .bias = false});
  y = ops::relu(norm(y, "bn2"));
  y = norm(layers.conv(y, "conv3", {.filters = channels, .kernel = 1, .bias = false}), "bn3");
  Value identity = x;
  if (first) {
    identity =
        layers.conv(x, "downsample.0", {.filters = channels, .kernel = 1, .stride = stride, .bias = false});
    identity = norm(identity, "downsample.1");
  }
  return ops::relu(ops::add(y, identity));
}

Value stage(const Layers& layers, Value x, std::string_view name, const Stage& s) {
  {
    const auto scope = x.graph().scope(name);
    for (int i = 0; i < s.blocks; ++i) {
      const auto block = x.graph().scope(std::to_string(i));
      x = bottleneck(layers, x, s, i == 0);
    }
  }
  return tapped(name, x);
}

/// What the decoder reads of the encoder: the first convolution, the first layer and the last.
struct Features {
  Value conv1, layer1, layer4;
};

Features encode(const Layers& layers, Value x) {
  const auto scope = x.graph().scope("encoder");
  x = layers.conv(x, "conv1", {.filters = 64, .kernel = 7, .stride = 2, .bias = false});
  const Value conv1 = ops::relu(norm(x, "bn1"));
  x = ops::max_pool2d(conv1, {.kernel = {3, 3}, .stride = {2, 2}, .padding = {1, 1, 1, 1}});
  const Value layer1 = stage(layers, x, "layer1", {.planes = 64, .blocks = 3});
  x = stage(layers, layer1, "layer2", {.planes = 128, .blocks = 4, .stride = 2});
  x = stage(layers, x, "layer3", {.planes = 256, .blocks = 6, .first_dilation = 1, .dilation = 2});
  x = stage(layers, x, "layer4", {.planes = 512, .blocks = 3, .first_dilation = 2, .dilation = 4});
  return {conv1, layer1, x};
}

/// Convolution `n` of a Sequential, its norm n+1 and a leaky ReLU.
Value conv_norm(const Layers& layers, Value x, int n, const ConvLayer& layer) {
  x = layers.conv(x, std::to_string(n), layer);
  return ops::leaky_relu(norm(x, std::to_string(n + 1)), kLeak);
}

Value pyramid_pooling(const Layers& layers, Value conv5) {
  const auto scope = conv5.graph().scope("ppm");
  std::vector<Value> levels{conv5};
  int index = 0;
  for (const std::int64_t size : {1, 2, 3, 6}) {
    const auto level = conv5.graph().scope(std::to_string(index++));
    Value x = ops::adaptive_avg_pool2d(conv5, size, size);
    x = conv_norm(layers, x, 1, {.filters = 256, .kernel = 1});
    levels.push_back(ops::resize_bilinear(x, conv5.shape()[2], conv5.shape()[3], false));
  }
  return ops::concat(levels, 1);
}

/// conv_up1 to conv_up3: convolutions with norms, at 0, 3, ... of a Sequential.
Value conv_up(const Layers& layers, Value x, std::string_view name, std::int64_t filters, int count) {
  {
    const auto scope = x.graph().scope(name);
    for (int i = 0; i < count; ++i) x = conv_norm(layers, x, 3 * i, {.filters = filters});
  }
  return tapped(name, x);
}

/// conv_up4: ordinary convolutions without norms.
Value conv_up4(Value x) {
  const auto scope = x.graph().scope("conv_up4");
  x = ops::leaky_relu(conv2d(x, "0", {.filters = 32}), kLeak);
  x = ops::leaky_relu(conv2d(x, "2", {.filters = 16}), kLeak);
  return conv2d(x, "4", {.filters = 7, .kernel = 1});
}

Value decode(const Layers& layers, const Features& features, const FbaInputs& in) {
  const auto scope = in.image.graph().scope("decoder");
  Value x = pyramid_pooling(layers, features.layer4);
  x = conv_up(layers, x, "conv_up1", 256, 2);
  x = conv_up(layers, ops::concat({ops::upsample_bilinear(x), features.layer1}, 1), "conv_up2", 256, 1);
  x = conv_up(layers, ops::concat({ops::upsample_bilinear(x), features.conv1}, 1), "conv_up3", 64, 1);
  return conv_up4(ops::concat({ops::upsample_bilinear(x), in.image_n, in.image, in.two_chan_trimap}, 1));
}

Value sum_of_channels(Value x) {
  return ops::affine(ops::reduce_mean(x, {1}), static_cast<double>(x.shape()[1]), 0);
}

Value complement(Value x) { return ops::affine(x, -1, 1); }

/// The authors' fba_fusion: one closed-form update for each of F, B and alpha, in this order.
Value fuse(Value alpha, Value image, Value f, Value b) {
  constexpr double kLambda = 0.1;
  const Value squared = ops::mul(alpha, alpha);
  const Value both = ops::mul(alpha, complement(alpha));
  f = ops::sub(ops::add(ops::mul(alpha, image), ops::mul(complement(squared), f)), ops::mul(both, b));
  const Value b_weight = ops::sub(ops::affine(alpha, 2, 0), squared);
  b = ops::sub(ops::add(ops::mul(complement(alpha), image), ops::mul(b_weight, b)), ops::mul(both, f));
  f = ops::clip(f, 0, 1);
  b = ops::clip(b, 0, 1);
  const Value difference = ops::sub(f, b);
  const Value along = sum_of_channels(ops::mul(ops::sub(image, b), difference));
  const Value length = sum_of_channels(ops::mul(difference, difference));
  alpha = ops::div(ops::add(ops::affine(alpha, kLambda, 0), along), ops::affine(length, 1, kLambda));
  return ops::concat({ops::clip(alpha, 0, 1), f, b}, 1);
}

/// |mean| <= 1e-4 · standard deviation for every filter of an O×C×KH×KW tensor.
bool means_are_zero(const Tensor& filters) {
  const Tensor wide = filters.to(DType::kF64);
  const std::span<const double> w = wide.data<double>();
  const auto count = static_cast<std::size_t>(filters.shape()[0]);
  if (count == 0) return true;
  const std::size_t n = w.size() / count;
  for (std::size_t o = 0; o < count; ++o) {
    double sum = 0;
    double squares = 0;
    for (const double v : w.subspan(o * n, n)) {
      sum += v;
      squares += v * v;
    }
    const double mean = sum / static_cast<double>(n);
    if (!(std::abs(mean) <= 1e-4 * std::sqrt(squares / static_cast<double>(n)))) return false;
  }
  return true;
}

}  // namespace

FbaConfig FbaConfig::from_weights(const WeightSource& weights) {
  if (weights.names().empty()) return {};
  const std::optional<Tensor> first = weights.find("encoder.conv1.weight", {});
  if (!first || first->empty() || first->shape().rank() != 4 || first->count() == 0) return {};
  return {.standardise_weights = !means_are_zero(*first)};
}

Value fba(const FbaInputs& in, const FbaConfig& config) {
  require_image("fba", in.image, 3, 8);
  require_image("fba", in.two_chan_trimap, 2, 8);
  require_image("fba", in.image_n, 3, 8);
  require_image("fba", in.trimap_transformed, 6, 8);
  const Layers layers(config);
  const Value x = ops::concat({in.image_n, in.trimap_transformed, in.two_chan_trimap}, 1);
  const Value y = decode(layers, encode(layers, x), in);
  const Value alpha = ops::clip(ops::slice(y, 1, 0, 1), 0, 1);
  return fuse(alpha, in.image, ops::sigmoid(ops::slice(y, 1, 1, 4)), ops::sigmoid(ops::slice(y, 1, 4, 7)));
}

}  // namespace slide::graphs
