#include "graphs/midas_v21.h"

#include <array>
#include <string>

#include "graphs/layers.h"
#include "graphs/midas_blocks.h"
#include "ops/pointwise/pointwise.h"
#include "ops/pool/pool.h"

namespace slide::graphs {
namespace {

struct Stage {
  std::int64_t planes;  // a quarter of the output channels
  int blocks;
  std::int64_t stride;
};

/// torchvision's Bottleneck with 32 groups of 8·planes/64 channels; the stride is in the 3×3 convolution.
Value bottleneck(Value x, std::int64_t planes, std::int64_t stride) {
  const std::int64_t width = 4 * planes;
  const std::int64_t channels = 4 * planes;
  Value y = conv2d(x, "conv1", {.filters = width, .kernel = 1, .bias = false});
  y = ops::relu(batch_norm(y, "bn1"));
  y = conv2d(y, "conv2", {.filters = width, .stride = stride, .groups = 32, .bias = false});
  y = ops::relu(batch_norm(y, "bn2"));
  y = batch_norm(conv2d(y, "conv3", {.filters = channels, .kernel = 1, .bias = false}), "bn3");
  Value identity = x;
  if (stride != 1 || x.shape()[1] != channels) {
    identity = conv2d(x, "downsample.0", {.filters = channels, .kernel = 1, .stride = stride, .bias = false});
    identity = batch_norm(identity, "downsample.1");
  }
  return ops::relu(ops::add(y, identity));
}

Value stage(Value x, const Stage& s) {
  for (int i = 0; i < s.blocks; ++i) {
    const auto scope = x.graph().scope(std::to_string(i));
    x = bottleneck(x, s.planes, i == 0 ? s.stride : 1);
  }
  return x;
}

Value layer1(Value x) {
  const auto scope = x.graph().scope("layer1");
  x = conv2d(x, "0", {.filters = 64, .kernel = 7, .stride = 2, .bias = false});
  x = ops::relu(batch_norm(x, "1"));
  x = ops::max_pool2d(x, {.kernel = {3, 3}, .stride = {2, 2}, .padding = {1, 1, 1, 1}});
  const auto blocks = x.graph().scope("4");
  return stage(x, {.planes = 64, .blocks = 3, .stride = 1});
}

Value layer(Value x, std::string_view name, const Stage& s) {
  const auto scope = x.graph().scope(name);
  return stage(x, s);
}

}  // namespace

Value midas_v21(Value x) {
  require_image("midas_v21", x, 3, 32);
  Graph& g = x.graph();

  const auto encode = [&](Value image) {
    const auto scope = g.scope("pretrained");
    const Value level1 = tapped("layer1", layer1(image));
    const Value level2 = tapped("layer2", layer(level1, "layer2", {.planes = 128, .blocks = 4, .stride = 2}));
    const Value level3 =
        tapped("layer3", layer(level2, "layer3", {.planes = 256, .blocks = 23, .stride = 2}));
    const Value level4 = tapped("layer4", layer(level3, "layer4", {.planes = 512, .blocks = 3, .stride = 2}));
    return std::array{level1, level2, level3, level4};
  };
  const auto [level1, level2, level3, level4] = encode(x);

  const auto scope = g.scope("scratch");
  const ConvLayer to_features{.filters = 256, .bias = false};
  const Value level1_rn = tapped("layer1_rn", conv2d(level1, "layer1_rn", to_features));
  const Value level2_rn = tapped("layer2_rn", conv2d(level2, "layer2_rn", to_features));
  const Value level3_rn = tapped("layer3_rn", conv2d(level3, "layer3_rn", to_features));
  const Value level4_rn = tapped("layer4_rn", conv2d(level4, "layer4_rn", to_features));

  const FusionBlock block{.skip = ResidualSkip::kRectified};
  const Value path4 = tapped("refinenet4", fuse_features(level4_rn, block, "refinenet4"));
  const Value path3 = tapped("refinenet3", fuse_features(path4, level3_rn, block, "refinenet3"));
  const Value path2 = tapped("refinenet2", fuse_features(path3, level2_rn, block, "refinenet2"));
  const Value path1 = tapped("refinenet1", fuse_features(path2, level1_rn, block, "refinenet1"));
  return depth_head(path1, 128);
}

}  // namespace slide::graphs
