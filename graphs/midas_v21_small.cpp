#include "graphs/midas_v21_small.h"

#include <array>
#include <string>

#include "graphs/layers.h"
#include "graphs/midas_blocks.h"
#include "ops/pointwise/pointwise.h"

namespace slide::graphs {
namespace {

constexpr double kEps = 1e-3;  // TensorFlow's batch norm
constexpr std::int64_t kExpansion = 6;

/// A run of inverted residual blocks; the first one has the stride.
struct Stage {
  std::int64_t channels;
  int blocks;
  std::int64_t kernel;
  std::int64_t stride;
};

Value pointwise(Value x, std::string_view conv, std::string_view bn, std::int64_t filters) {
  return batch_norm(conv2d(x, conv, {.filters = filters, .kernel = 1, .bias = false}), bn, kEps);
}

Value depthwise(Value x, std::string_view bn, std::int64_t kernel, std::int64_t stride) {
  const std::int64_t channels = x.shape()[1];
  const ConvLayer layer{
      .filters = channels, .kernel = kernel, .stride = stride, .groups = channels, .bias = false};
  return ops::relu6(batch_norm(conv2d_tf_same(x, "conv_dw", layer), bn, kEps));
}

/// DepthwiseSeparableConv: depthwise, then a linear pointwise convolution.
Value separable(Value x, std::int64_t channels) {
  Value y = depthwise(x, "bn1", 3, 1);
  y = pointwise(y, "conv_pw", "bn2", channels);
  return x.shape()[1] == channels ? ops::add(y, x) : y;
}

/// InvertedResidual: pointwise expansion, depthwise, linear pointwise projection.
Value inverted_residual(Value x, const Stage& s, std::int64_t stride) {
  Value y = ops::relu6(pointwise(x, "conv_pw", "bn1", kExpansion * x.shape()[1]));
  y = depthwise(y, "bn2", s.kernel, stride);
  y = pointwise(y, "conv_pwl", "bn3", s.channels);
  return stride == 1 && x.shape()[1] == s.channels ? ops::add(y, x) : y;
}

Value stage(Value x, std::string_view name, const Stage& s) {
  const auto scope = x.graph().scope(name);
  for (int i = 0; i < s.blocks; ++i) {
    const auto block = x.graph().scope(std::to_string(i));
    x = inverted_residual(x, s, i == 0 ? s.stride : 1);
  }
  return x;
}

Value layer1(Value x) {
  const auto scope = x.graph().scope("layer1");
  x = conv2d_tf_same(x, "0", {.filters = 32, .stride = 2, .bias = false});
  x = ops::relu6(batch_norm(x, "1", kEps));
  {
    const auto first = x.graph().scope("3.0");
    x = separable(x, 24);
  }
  return stage(x, "4", {.channels = 32, .blocks = 3, .kernel = 3, .stride = 2});
}

Value layer2(Value x) {
  const auto scope = x.graph().scope("layer2");
  return stage(x, "0", {.channels = 48, .blocks = 3, .kernel = 5, .stride = 2});
}

Value layer3(Value x) {
  const auto scope = x.graph().scope("layer3");
  x = stage(x, "0", {.channels = 96, .blocks = 5, .kernel = 3, .stride = 2});
  return stage(x, "1", {.channels = 136, .blocks = 5, .kernel = 5, .stride = 1});
}

Value layer4(Value x) {
  const auto scope = x.graph().scope("layer4");
  x = stage(x, "0", {.channels = 232, .blocks = 6, .kernel = 5, .stride = 2});
  return stage(x, "1", {.channels = 384, .blocks = 1, .kernel = 3, .stride = 1});
}

}  // namespace

Value midas_v21_small(Value x) {
  require_image("midas_v21_small", x, 3, 32);
  Graph& g = x.graph();

  const auto encode = [&](Value image) {
    const auto scope = g.scope("pretrained");
    const Value level1 = tapped("layer1", layer1(image));
    const Value level2 = tapped("layer2", layer2(level1));
    const Value level3 = tapped("layer3", layer3(level2));
    const Value level4 = tapped("layer4", layer4(level3));
    return std::array{level1, level2, level3, level4};
  };
  const auto [level1, level2, level3, level4] = encode(x);

  const auto scope = g.scope("scratch");
  const auto to_features = [](Value level, std::string_view name, std::int64_t features) {
    return tapped(name, conv2d(level, name, {.filters = features, .bias = false}));
  };
  const Value level1_rn = to_features(level1, "layer1_rn", 64);
  const Value level2_rn = to_features(level2, "layer2_rn", 128);
  const Value level3_rn = to_features(level3, "layer3_rn", 256);
  const Value level4_rn = to_features(level4, "layer4_rn", 512);

  const auto block = [](std::int64_t out_channels) {
    return FusionBlock{.skip = ResidualSkip::kAsGiven, .out_channels = out_channels};
  };
  const Value path4 = tapped("refinenet4", fuse_features(level4_rn, block(256), "refinenet4"));
  const Value path3 = tapped("refinenet3", fuse_features(path4, level3_rn, block(128), "refinenet3"));
  const Value path2 = tapped("refinenet2", fuse_features(path3, level2_rn, block(64), "refinenet2"));
  const Value path1 = tapped("refinenet1", fuse_features(path2, level1_rn, block(64), "refinenet1"));
  return depth_head(path1, 32);
}

}  // namespace slide::graphs
