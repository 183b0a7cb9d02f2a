#include "graphs/inpaint_coarse.h"

#include "graphs/gated_layers.h"
#include "graphs/layers.h"
#include "ops/pointwise/pointwise.h"
#include "ops/resize/resize.h"
#include "runtime/error.h"

namespace slide::graphs {

InpaintCoarseConfig InpaintCoarseConfig::from_weights(const WeightSource& weights) {
  const std::optional<Shape> first = filter_shape(weights, "conv1.conv.weight");
  const std::optional<Shape> last = filter_shape(weights, "conv16.conv.weight");
  if (!first || !last) return {};
  InpaintCoarseConfig config;
  config.width = (*first)[0] / 2;
  config.image_channels = (*first)[1] - 2;  // beside them: ones and the mask
  config.gated_last = (*last)[0] == 2 * config.image_channels;
  const bool fits = (*first)[0] % 4 == 0 && config.image_channels >= 1 &&
                    (config.gated_last || (*last)[0] == config.image_channels);
  if (!fits)
    throw Error(ErrorKind::kBadWeights,
                weights.description() + ": conv1.conv.weight has shape " + first->text() +
                    " and conv16.conv.weight has shape " + last->text() +
                    ", which fit no coarse inpainting network (2·width x channels+2 filters first, width a "
                    "multiple of 2; channels or 2·channels filters last)");
  return config;
}

Value inpaint_coarse(Value image, Value mask, const InpaintCoarseConfig& config) {
  require_image("inpaint_coarse", image, config.image_channels, 4);
  require_image("inpaint_coarse", mask, 1, 4);
  const std::int64_t c = config.width;

  Value x = with_mask(ops::mul(image, ops::affine(mask, -1, 1)), mask);
  x = gated_conv(x, "conv1", {.channels = c, .kernel = 5, .stride = 2});
  x = gated_conv(x, "conv2", {.channels = c});
  x = gated_conv(x, "conv3", {.channels = 2 * c, .stride = 2});
  x = gated_conv(x, "conv4", {.channels = 2 * c});
  x = gated_conv(x, "conv5", {.channels = 4 * c});
  x = gated_conv(x, "conv6", {.channels = 4 * c, .dilation = 2});
  x = gated_conv(x, "conv7", {.channels = 4 * c, .dilation = 4});
  x = gated_conv(x, "conv8", {.channels = 4 * c, .dilation = 8});
  x = gated_conv(x, "conv9", {.channels = 4 * c, .dilation = 16});
  x = gated_conv(x, "conv10", {.channels = 4 * c});
  x = gated_conv(x, "conv11", {.channels = 4 * c});
  x = gated_conv(ops::upsample_nearest(x, 2), "conv12", {.channels = 2 * c});
  x = gated_conv(x, "conv13", {.channels = 2 * c});
  x = gated_conv(ops::upsample_nearest(x, 2), "conv14", {.channels = c});
  x = gated_conv(x, "conv15", {.channels = c / 2});
  x = config.gated_last ? gated_conv(x, "conv16", {.channels = config.image_channels})
                        : plain_conv(x, "conv16", config.image_channels);
  return ops::tanh(x);
}

}  // namespace slide::graphs
