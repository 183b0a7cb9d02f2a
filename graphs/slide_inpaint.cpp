#include "graphs/slide_inpaint.h"

#include <algorithm>
#include <cmath>

#include "graphs/layers.h"
#include "graphs/neighbourhood.h"
#include "graphs/unet.h"
#include "ops/fill/fill.h"
#include "ops/fill/mirror.h"
#include "ops/layering/layering.h"
#include "ops/pointwise/pointwise.h"
#include "ops/tensor_shape/tensor_shape.h"

namespace slide::graphs {
namespace {

constexpr int kSweeps = 4;
constexpr double kGap = 1.0 / 16;        // disparity behind the front from which a pixel is background
constexpr std::int64_t kJumpReach = 12;  // of the margin: within them lies what a jump falls to
constexpr double kRest = 1e-11;
constexpr std::int64_t kReach = 4;    // pixels: within them the largest disparity is the cover's
constexpr double kLeast = 1.0 / 128;  // smallest step of disparity that counts
// Of the way from the background's disparity to the cover's: background wholly up to kFar, not from kNear on.
constexpr double kFar = 0.1;
constexpr double kNear = 0.4;
constexpr double kMarginPart = 1.0 / 300;  // of the longer side
constexpr double kMarginWeight = 0.05;
constexpr double kSource = 0.5;
constexpr double kDetail = 1.75;
constexpr double kDetailLimit = 0.1;
// The probabilities of background that weights of 0 and 1 stand for: what is doubtful gives no colour.
constexpr double kLow = 0.35;
constexpr double kHigh = 0.85;
constexpr std::int64_t kEighth = 48;  // channels of the U-Net at an eighth of the size, and on its way back
constexpr std::int64_t kLast = 8;
constexpr std::int64_t kMultiple = 8;

/// colour_weight(), as the network corrects it.
Value weight_by_network(Value rgb, Value disparity, Value behind, Value weight, Value hole) {
  const Value smooth = ops::push_pull_fill(rgb, weight, kSweeps);
  const Value change =
      small_unet(ops::concat({rgb, smooth, disparity, behind, weight, hole}, 1), kEighth, kLast);
  const Value p = ops::affine(weight, kHigh - kLow, kLow);
  const Value moved = moved_by_log_odds(p, change);
  return tapped("weight",
                ops::clip(ops::affine(moved, 1 / (kHigh - kLow), -kLow / (kHigh - kLow)), kRest, 1));
}

/// The fill, with weights by disparity or corrected by the network.
Value fill(Value rgbd, Value disparity, Value hole, const FillSources& sources, bool network) {
  const Value rgb = ops::slice(rgbd, 1, 0, 3);
  const Value behind = ops::push_pull_fill(
      disparity, background_weight(disparity, hole, kJumpReach * sources.margin), kSweeps);
  const Value plain = colour_weight(disparity, behind);
  std::optional<Value> kept;
  if (sources.margin > 0) kept = kept_beside_margin(plain, sources.margin);
  const auto usable = [&](Value w) {
    const Value off_margin = kept ? ops::clip(ops::mul(w, *kept), kRest, 1) : w;
    return sources.matte ? matted_weight(off_margin, *sources.matte) : off_margin;
  };
  const Value known = usable(plain);
  const Value weight = network ? usable(weight_by_network(rgb, disparity, behind, plain, hole)) : known;
  const Value smooth = ops::push_pull_fill(rgb, weight, kSweeps);
  return ops::concat({ops::add(smooth, detail(rgb, weight, known)), ops::affine(behind, 2, -1)}, 1);
}

}  // namespace

Value background_weight(Value disparity, Value hole, std::int64_t reach) {
  const Value depth = ops::sub(ops::push_pull_fill(disparity, hole, 0), disparity);
  const auto behind = [&] {
    if (reach == 0) return ops::affine(depth, 1 / kGap, 0);
    const Value jump = ops::clip(largest_around(depth, reach), kGap, 1);
    return ops::affine(ops::div(depth, jump), 8, -0.5);  // of the jump, from a sixteenth to three
  };
  return ops::clip(ops::mul(ops::affine(hole, -1, 1), ops::clip(behind(), 0, 1)), kRest, 1);
}

Value colour_weight(Value disparity, Value behind) {
  const Value step = ops::clip(ops::sub(largest_around(disparity, kReach), behind), kLeast, 1);
  const Value way = ops::div(ops::sub(disparity, behind), step);
  return ops::clip(ops::affine(way, -1 / (kNear - kFar), kNear / (kNear - kFar)), kRest, 1);
}

Value matted_weight(Value weight, const SubjectMatte& matte) {
  const Value moved = ops::mul(matte.agreement, ops::sub(matte.clear, weight));
  return ops::clip(ops::add(weight, moved), kRest, 1);
}

std::int64_t fill_margin(const Shape& photo) {
  const auto longer = static_cast<double>(std::max(photo[-1], photo[-2]));
  return static_cast<std::int64_t>(std::round(kMarginPart * longer));
}

Value kept_beside_margin(Value weight, std::int64_t margin) {
  const Value source = least_around(ops::greater(weight, kSource), margin);
  return ops::affine(source, 1 - kMarginWeight, kMarginWeight);
}

Value detail(Value rgb, Value weight, Value known) {
  const Value blurred = ops::div(ops::gaussian_blur(ops::mul(rgb, weight), 1), ops::gaussian_blur(weight, 1));
  const Value fine = ops::mul(ops::sub(rgb, blurred), weight);
  const Value mirrored =
      ops::clip(ops::affine(ops::mirror_known(fine, known), kDetail, 0), -kDetailLimit, kDetailLimit);
  return ops::mul(mirrored, ops::affine(weight, -1, 1));
}

Value background_fill(Value rgbd, Value disparity, Value hole, const FillSources& sources) {
  require_image("background_fill", rgbd, 4, 1);
  return fill(rgbd, disparity, hole, sources, false);
}

Value slide_inpaint(Value rgbd, Value disparity, Value hole, const FillSources& sources) {
  require_image("slide_inpaint", rgbd, 4, kMultiple);
  require_image("slide_inpaint", disparity, 1, kMultiple);
  require_image("slide_inpaint", hole, 1, kMultiple);
  return fill(rgbd, disparity, hole, sources, true);
}

}  // namespace slide::graphs
