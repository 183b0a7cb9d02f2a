#include "graphs/slide_inpaint.h"

#include "graphs/gated_layers.h"
#include "graphs/layers.h"
#include "ops/fill/fill.h"
#include "ops/pointwise/pointwise.h"
#include "ops/resize/resize.h"
#include "ops/tensor_shape/tensor_shape.h"

namespace slide::graphs {
namespace {

constexpr int kSweeps = 4;
constexpr double kGap = 1.0 / 16;  // disparity behind the front from which a pixel is background
constexpr double kRest = 1e-6;

/// The paper's coarse network without its masking and its tanh.
Value correction(Value x) {
  const std::int64_t c = kSlideInpaintWidth;
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
  return plain_conv(x, "conv16", 4);
}

}  // namespace

Value background_weight(Value disparity, Value hole) {
  const Value front = ops::push_pull_fill(disparity, hole, 0);
  const Value behind = ops::clip(ops::affine(ops::sub(front, disparity), 1 / kGap, 0), 0, 1);
  return ops::clip(ops::mul(ops::affine(hole, -1, 1), behind), kRest, 1);
}

Value background_fill(Value image, Value disparity, Value hole) {
  return ops::push_pull_fill(image, background_weight(disparity, hole), kSweeps);
}

Value slide_inpaint(Value rgbd, Value disparity, Value hole) {
  require_image("slide_inpaint", rgbd, 4, 4);
  require_image("slide_inpaint", disparity, 1, 4);
  require_image("slide_inpaint", hole, 1, 4);
  const Value weight = background_weight(disparity, hole);
  const Value filled = tapped("filled", ops::push_pull_fill(rgbd, weight, kSweeps));
  return ops::add(filled, correction(ops::concat({filled, weight, hole}, 1)));
}

}  // namespace slide::graphs
