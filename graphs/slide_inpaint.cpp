#include "graphs/slide_inpaint.h"

#include "graphs/gated_layers.h"
#include "graphs/layers.h"
#include "ops/fill/fill.h"
#include "ops/fill/mirror.h"
#include "ops/layering/layering.h"
#include "ops/pointwise/pointwise.h"
#include "ops/pool/pool.h"
#include "ops/reduce/reduce.h"
#include "ops/resize/resize.h"
#include "ops/tensor_shape/tensor_shape.h"

namespace slide::graphs {
namespace {

constexpr int kSweeps = 4;
constexpr double kGap = 1.0 / 16;  // disparity behind the front from which a pixel is background
constexpr double kRest = 1e-8;
constexpr std::int64_t kRim = 5;    // pixels: side of the window that says whether known background is near
constexpr double kLike = 1.0 / 64;  // squared difference of colours that says nothing
constexpr double kDetail = 1.75;
constexpr double kDetailLimit = 0.1;

struct Fill {
  Value smooth;    ///< RGBD
  Value textured;  ///< the same, with detail()
  Value weight;    ///< of the colours
};

Value squared(Value x) { return ops::mul(x, x); }

Value difference(Value x, Value y) { return ops::reduce_mean(squared(ops::sub(x, y)), {1}); }

Fill fill(Value rgbd, Value disparity, Value hole) {
  const Value rgb = ops::slice(rgbd, 1, 0, 3);
  const Value weight = background_weight(disparity, hole);
  const Value colours = colour_weight(rgb, weight, hole);
  const Value behind = ops::push_pull_fill(ops::slice(rgbd, 1, 3, 4), weight, kSweeps);
  const Value smooth = ops::push_pull_fill(rgb, colours, kSweeps);
  return {tapped("filled", ops::concat({smooth, behind}, 1)),
          ops::concat({ops::add(smooth, detail(rgb, colours)), behind}, 1), colours};
}

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

Value colour_weight(Value rgb, Value weight, Value hole) {
  const Value covers = ops::clip(ops::sub(ops::affine(hole, -1, 1), weight), kRest, 1);
  const Value behind = squared(difference(rgb, ops::push_pull_fill(rgb, weight, kSweeps)));
  const Value before = squared(difference(rgb, ops::push_pull_fill(rgb, covers, kSweeps)));
  const Value likely = ops::div(before, ops::affine(ops::add(behind, before), 1, kLike * kLike));
  constexpr std::int64_t kPad = kRim / 2;
  const Value near = ops::max_pool2d(
      weight, {.kernel = {kRim, kRim}, .stride = {1, 1}, .padding = {kPad, kPad, kPad, kPad}});
  return ops::maximum(weight, ops::mul(near, likely));
}

Value detail(Value rgb, Value weight) {
  const Value blurred = ops::div(ops::gaussian_blur(ops::mul(rgb, weight), 1), ops::gaussian_blur(weight, 1));
  const Value fine = ops::mul(ops::sub(rgb, blurred), weight);
  const Value mirrored =
      ops::clip(ops::affine(ops::mirror_known(fine, weight), kDetail, 0), -kDetailLimit, kDetailLimit);
  return ops::mul(mirrored, ops::affine(weight, -1, 1));
}

Value background_fill(Value rgbd, Value disparity, Value hole) {
  require_image("background_fill", rgbd, 4, 1);
  return fill(rgbd, disparity, hole).textured;
}

Value slide_inpaint(Value rgbd, Value disparity, Value hole) {
  require_image("slide_inpaint", rgbd, 4, 4);
  require_image("slide_inpaint", disparity, 1, 4);
  require_image("slide_inpaint", hole, 1, 4);
  const auto [smooth, textured, weight] = fill(rgbd, disparity, hole);
  return ops::add(textured, correction(ops::concat({smooth, weight, hole}, 1)));
}

}  // namespace slide::graphs
