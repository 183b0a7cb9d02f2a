#include "graphs/slide_inpaint.h"

#include <algorithm>

#include "graphs/gated_layers.h"
#include "graphs/layers.h"
#include "ops/fill/fill.h"
#include "ops/fill/mirror.h"
#include "ops/layering/layering.h"
#include "ops/pointwise/pointwise.h"
#include "ops/pool/pool.h"
#include "ops/resize/resize.h"
#include "ops/tensor_shape/tensor_shape.h"

namespace slide::graphs {
namespace {

constexpr int kSweeps = 4;
constexpr double kGap = 1.0 / 16;  // disparity behind the front from which a pixel is background
constexpr double kRest = 1e-8;
constexpr std::int64_t kWindow = 9;   // pixels: side of the window whose largest disparity is the cover's
constexpr double kLeast = 1.0 / 128;  // smallest step of disparity that counts
// Of the way from the background's disparity to the cover's: background wholly up to kFar, not from kNear on.
constexpr double kFar = 0.1;
constexpr double kNear = 0.4;
// The photo's longer side over it: so far around the subject its matte counts.
constexpr std::int64_t kMatteReach = 20;
// Alpha from which a pixel of an exact matte is not background at all.
constexpr double kClear = 0.1;
constexpr double kDetail = 1.75;
constexpr double kDetailLimit = 0.1;

struct Fill {
  Value smooth;    ///< RGBD
  Value textured;  ///< the same, with detail()
  Value weight;    ///< of the colours
};

/// The largest value of the window of that side around each pixel.
Value largest_around(Value x, std::int64_t side) {
  const std::int64_t pad = side / 2;
  return ops::max_pool2d(x, {.kernel = {side, side}, .stride = {1, 1}, .padding = {pad, pad, pad, pad}});
}

Fill fill(Value rgbd, Value disparity, Value hole, const std::optional<SubjectMatte>& matte) {
  const Value rgb = ops::slice(rgbd, 1, 0, 3);
  const Value behind = ops::push_pull_fill(disparity, background_weight(disparity, hole), kSweeps);
  const Value by_disparity = colour_weight(disparity, behind);
  const Value colours = matte ? matted_weight(by_disparity, *matte) : by_disparity;
  const Value smooth = ops::push_pull_fill(rgb, colours, kSweeps);
  const Value signed_behind = ops::affine(behind, 2, -1);
  return {tapped("filled", ops::concat({smooth, signed_behind}, 1)),
          ops::concat({ops::add(smooth, detail(rgb, colours)), signed_behind}, 1), colours};
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

Value colour_weight(Value disparity, Value behind) {
  const Value step = ops::clip(ops::sub(largest_around(disparity, kWindow), behind), kLeast, 1);
  const Value way = ops::div(ops::sub(disparity, behind), step);
  return ops::clip(ops::affine(way, -1 / (kNear - kFar), kNear / (kNear - kFar)), kRest, 1);
}

std::int64_t matte_reach(std::int64_t height, std::int64_t width) {
  return (std::max(height, width) + kMatteReach / 2) / kMatteReach;
}

Value matted_weight(Value weight, const SubjectMatte& matte) {
  const Value covering = ops::mul(matte.alpha, ops::affine(weight, -1, 1));
  const Value near = largest_around(covering, 2 * matte.reach + 1);
  if (matte.exact) {
    const Value clear = ops::clip(ops::affine(matte.alpha, -1 / kClear, 1), 0, 1);
    return ops::clip(ops::add(weight, ops::mul(near, ops::sub(clear, weight))), kRest, 1);
  }
  const Value open = ops::affine(matte.alpha, -1, 1);
  const Value taken = ops::mul(near, ops::affine(ops::mul(open, open), -1, 1));
  return ops::clip(ops::mul(weight, ops::affine(taken, -1, 1)), kRest, 1);
}

Value detail(Value rgb, Value weight) {
  const Value blurred = ops::div(ops::gaussian_blur(ops::mul(rgb, weight), 1), ops::gaussian_blur(weight, 1));
  const Value fine = ops::mul(ops::sub(rgb, blurred), weight);
  const Value mirrored =
      ops::clip(ops::affine(ops::mirror_known(fine, weight), kDetail, 0), -kDetailLimit, kDetailLimit);
  return ops::mul(mirrored, ops::affine(weight, -1, 1));
}

Value background_fill(Value rgbd, Value disparity, Value hole, const std::optional<SubjectMatte>& matte) {
  require_image("background_fill", rgbd, 4, 1);
  return fill(rgbd, disparity, hole, matte).textured;
}

Value slide_inpaint(Value rgbd, Value disparity, Value hole, const std::optional<SubjectMatte>& matte) {
  require_image("slide_inpaint", rgbd, 4, 4);
  require_image("slide_inpaint", disparity, 1, 4);
  require_image("slide_inpaint", hole, 1, 4);
  const auto [smooth, textured, weight] = fill(rgbd, disparity, hole, matte);
  return ops::add(textured, correction(ops::concat({smooth, weight, hole}, 1)));
}

}  // namespace slide::graphs
