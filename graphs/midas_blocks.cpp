#include "graphs/midas_blocks.h"

#include "graphs/layers.h"
#include "ops/pointwise/pointwise.h"
#include "ops/resize/resize.h"

namespace slide::graphs {
namespace {

Value refine_and_upsample(Value x, const FusionBlock& block) {
  x = residual_conv_unit(x, "resConfUnit2", block.skip);
  const std::int64_t height = block.height != 0 ? block.height : 2 * x.shape()[2];
  const std::int64_t width = block.width != 0 ? block.width : 2 * x.shape()[3];
  x = ops::resize_bilinear(x, height, width, true);
  if (block.out_channels > 0) x = conv2d(x, "out_conv", {.filters = block.out_channels, .kernel = 1});
  return x;
}

}  // namespace

Value residual_conv_unit(Value x, std::string_view name, ResidualSkip skip) {
  const auto scope = x.graph().scope(name);
  const std::int64_t channels = x.shape()[1];
  const Value rectified = ops::relu(x);
  Value y = conv2d(rectified, "conv1", {.filters = channels});
  y = conv2d(ops::relu(y), "conv2", {.filters = channels});
  return ops::add(y, skip == ResidualSkip::kRectified ? rectified : x);
}

Value fuse_features(Value path, const FusionBlock& block, std::string_view name) {
  const auto scope = path.graph().scope(name);
  return refine_and_upsample(path, block);
}

Value fuse_features(Value path, Value level, const FusionBlock& block, std::string_view name) {
  const auto scope = path.graph().scope(name);
  const Value sum = ops::add(path, residual_conv_unit(level, "resConfUnit1", block.skip));
  return refine_and_upsample(sum, block);
}

Value depth_head(Value x, std::int64_t channels) {
  const auto scope = x.graph().scope("output_conv");
  x = conv2d(x, "0", {.filters = channels});
  x = ops::upsample_bilinear(x);
  x = ops::relu(conv2d(x, "2", {.filters = 32}));
  return ops::relu(conv2d(x, "4", {.filters = 1, .kernel = 1}));
}

}  // namespace slide::graphs
