#include "graphs/inpaint_deepfill.h"

#include "graphs/gated_layers.h"
#include "graphs/layers.h"
#include "ops/attention/contextual_attention.h"
#include "ops/pointwise/pointwise.h"
#include "ops/resize/resize.h"
#include "ops/tensor_shape/tensor_shape.h"
#include "runtime/error.h"

namespace slide::graphs {
namespace {

/// GDownsamplingBlock: a strided layer, then one that may change the number of channels.
Value down_block(Value x, std::string_view name, std::int64_t hidden, std::int64_t channels) {
  const auto scope = x.graph().scope(name);
  x = gated_conv(x, "conv1_downsample", {.channels = hidden, .stride = 2});
  return gated_conv(x, "conv2", {.channels = channels});
}

/// GUpsamplingBlock: nearest ×2 and a layer, then another.
Value up_block(Value x, std::string_view name, std::int64_t hidden, std::int64_t channels) {
  const auto scope = x.graph().scope(name);
  x = gated_conv(ops::upsample_nearest(x, 2), "conv1_upsample.conv", {.channels = hidden});
  return gated_conv(x, "conv2", {.channels = channels});
}

/// Layers with dilation 2, 4, 8, 16, named `prefix`2 to `prefix`5.
Value dilated(Value x, const std::string& prefix) {
  const std::int64_t channels = x.shape()[1];
  x = gated_conv(x, prefix + "2", {.channels = channels, .dilation = 2});
  x = gated_conv(x, prefix + "3", {.channels = channels, .dilation = 4});
  x = gated_conv(x, prefix + "4", {.channels = channels, .dilation = 8});
  return gated_conv(x, prefix + "5", {.channels = channels, .dilation = 16});
}

Value decode(Value x, const InpaintDeepfillConfig& config) {
  const std::int64_t c = config.cnum;
  x = gated_conv(x, "conv_bn6", {.channels = 2 * c});
  x = gated_conv(x, "conv_bn7", {.channels = 2 * c});
  x = up_block(x, "up_block1", c, c);
  x = up_block(x, "up_block2", c / 2, c / 4);
  return ops::tanh(plain_conv(x, "conv_to_rgb", config.image_channels));
}

Value coarse_generator(Value x, const InpaintDeepfillConfig& config) {
  const auto scope = x.graph().scope("stage1");
  const std::int64_t c = config.cnum;
  x = gated_conv(x, "conv1", {.channels = c / 2, .kernel = 5});
  x = down_block(x, "down_block1", c, c);
  x = down_block(x, "down_block2", 2 * c, 2 * c);
  x = gated_conv(x, "conv_bn1", {.channels = 2 * c});
  x = dilated(x, "conv_bn");
  return decode(x, config);
}

Value dilated_branch(Value x, std::int64_t c) {
  x = gated_conv(x, "conv_conv1", {.channels = c / 2, .kernel = 5});
  x = down_block(x, "conv_down_block1", c / 2, c);
  x = down_block(x, "conv_down_block2", c, 2 * c);
  x = gated_conv(x, "conv_conv_bn1", {.channels = 2 * c});
  return dilated(x, "conv_conv_bn");
}

Value attention_branch(Value x, Value mask, std::int64_t c) {
  x = gated_conv(x, "ca_conv1", {.channels = c / 2, .kernel = 5});
  x = down_block(x, "ca_down_block1", c / 2, c);
  x = down_block(x, "ca_down_block2", 2 * c, 2 * c);
  x = gated_conv_relu(x, "ca_conv_bn1", {.channels = 2 * c});
  {
    const auto scope = x.graph().scope("contextual_attention");
    const ops::ContextualAttentionParams params{.patch = 3, .rate = 2, .softmax_scale = 10, .fuse = 3};
    const Value fuse_weight = x.graph().parameter("fuse_weight", {1, 1, params.fuse, params.fuse});
    x = ops::contextual_attention(x, x, mask, params, fuse_weight);
  }
  tapped("contextual_attention", x);
  x = gated_conv(x, "ca_conv_bn4", {.channels = 2 * c});
  return gated_conv(x, "ca_conv_bn5", {.channels = 2 * c});
}

Value fine_generator(Value x, Value mask, const InpaintDeepfillConfig& config) {
  const auto scope = x.graph().scope("stage2");
  const Value hallucinated = dilated_branch(x, config.cnum);
  const Value matched = attention_branch(x, mask, config.cnum);
  return decode(ops::concat({hallucinated, matched}, 1), config);
}

}  // namespace

InpaintDeepfillConfig InpaintDeepfillConfig::from_weights(const WeightSource& weights) {
  const std::optional<Shape> first = filter_shape(weights, "stage1.conv1.conv.weight");
  if (!first) return {};
  const InpaintDeepfillConfig config{.cnum = (*first)[0], .image_channels = (*first)[1] - 2};
  if (config.cnum % 4 != 0 || config.image_channels < 1)
    throw Error(ErrorKind::kBadWeights,
                weights.description() + ": stage1.conv1.conv.weight has shape " + first->text() +
                    ", which fits no DeepFillv2 generator (cnum x channels+2 filters, cnum a multiple of 4)");
  return config;
}

InpaintDeepfillResult inpaint_deepfill(Value image, Value mask, const InpaintDeepfillConfig& config) {
  require_image("inpaint_deepfill", image, config.image_channels, 8);
  require_image("inpaint_deepfill", mask, 1, 8);
  const Value known = ops::affine(mask, -1, 1);
  const Value masked = ops::mul(image, known);
  const Value coarse = coarse_generator(with_mask(masked, mask), config);
  const Value pasted = ops::add(ops::mul(coarse, mask), ops::mul(masked, known));
  return {coarse, fine_generator(pasted, mask, config)};
}

}  // namespace slide::graphs
