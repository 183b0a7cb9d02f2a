#include "graphs/edges.h"

#include "graphs/neighbourhood.h"
#include "ops/edges/median.h"
#include "ops/pointwise/pointwise.h"
#include "ops/reduce/reduce.h"

namespace slide::graphs {
namespace {

/// Windows' radii as parts of the longer side.
constexpr double kMedianPart = 1.0 / 500;
constexpr double kSteepenPart = 1.0 / 160;
constexpr double kSnapPart = 1.0 / 60;
constexpr int kSteepenPasses = 2;

/// Ranges of disparity: below the first a slope, above the second a jump.
constexpr double kSlope = 0.03;
constexpr double kJump = 0.06;
/// The largest part of a range that is put down to a slope.
constexpr double kSteepestSlope = 0.06;

/// Squared colour differences below this say nothing.
constexpr double kColourNoise = 2e-3;
/// What a pixel's place says, against its colour: all of a window on one side, and the side it is on so far.
constexpr double kPlace = 2;
constexpr double kStay = 0.1;
/// Weight of a pixel that no jump is near: nothing is divided by zero.
constexpr double kLeastWeight = 1e-9;

/// How much of a jump a range of disparity is.
Value jump_of(Value range) { return smoothstep(range, kSlope, kJump); }

/// The extremes around each pixel, and how much of a jump lies between them.
struct Surroundings {
  Value low, high, jump;

  Surroundings(Value d, std::int64_t radius)
      : low(least_around(d, radius)), high(largest_around(d, radius)), jump(jump_of(beyond_slope(radius))) {}

  /// 1 where d is nearer to the high end.
  [[nodiscard]] Value above_middle(Value d) const {
    return ops::greater(ops::sub(ops::sub(d, low), ops::sub(high, d)), 0);
  }
  /// d moved to the high end where `to_high` is 1 and to the low one where it is 0, where there is a jump.
  [[nodiscard]] Value moved(Value d, Value to_high) const {
    const Value target = ops::add(low, ops::mul(to_high, ops::sub(high, low)));
    return ops::add(d, ops::mul(jump, ops::sub(target, d)));
  }

 private:
  /// The range without what a slope has: a window three times as wide has three times the range of a slope,
  /// and that of a jump.
  [[nodiscard]] Value beyond_slope(std::int64_t radius) const {
    const Value range = ops::sub(high, low);
    const Value wide = ops::sub(largest_around(high, 2 * radius), least_around(low, 2 * radius));
    const Value slope = ops::affine(ops::sub(wide, range), 0.5, 0);
    return ops::sub(range, ops::clip(slope, 0, kSteepestSlope));
  }
};

Value sum_of_planes(Value x) { return ops::affine(ops::reduce_mean(x, {1}), 3, 0); }

/// Mean colour and variance, summed over the channels, of the pixels of a window, each with its weight.
struct SideColours {
  Value mean, variance;
  Value share;  ///< of all weight that the window could hold

  SideColours(Value image, Value squares, Value weight, std::int64_t radius)
      : mean(image), variance(squares), share(weight) {
    const Value w = ops::affine(weight, 1, kLeastWeight);
    share = smooth_mean(w, radius);
    mean = ops::div(smooth_mean(ops::mul(image, w), radius), share);
    variance = ops::sub(ops::div(smooth_mean(ops::mul(squares, w), radius), share),
                        sum_of_planes(ops::mul(mean, mean)));
  }
};

Value squared_distance(Value a, Value b) {
  const Value difference = ops::sub(a, b);
  return sum_of_planes(ops::mul(difference, difference));
}

/// Step 3.
Value snap(Value d, Value image) {
  const std::int64_t radius = pixels_of(d, kSnapPart);
  const Surroundings around(d, radius);
  const Value near = around.above_middle(d);
  const Value squares = sum_of_planes(ops::mul(image, image));
  const Value near_weight = ops::mul(near, around.jump);
  const SideColours front(image, squares, near_weight, radius);
  const SideColours back(image, squares, ops::sub(around.jump, near_weight), radius);
  const Value closer_to_front =
      ops::sub(squared_distance(image, back.mean), squared_distance(image, front.mean));
  const Value spread =
      ops::affine(ops::add(squared_distance(front.mean, back.mean), ops::add(front.variance, back.variance)),
                  1, kColourNoise);
  const Value share = ops::div(front.share, ops::add(front.share, back.share));
  const Value place = ops::add(ops::affine(share, kPlace, -kPlace / 2), ops::affine(near, 2 * kStay, -kStay));
  const Value votes = ops::greater(ops::add(ops::div(closer_to_front, spread), place), 0);
  const Value majority = ops::greater(mean_around(votes, pixels_of(d, kMedianPart)), 0.5);
  return around.moved(d, majority);
}

}  // namespace

Value sharpen_edges(Value disparity, Value image) {
  const auto scope = disparity.graph().scope("edges");
  Value d = ops::median(disparity, pixels_of(disparity, kMedianPart));
  for (int pass = 0; pass < kSteepenPasses; ++pass) {
    const Surroundings around(d, pixels_of(d, kSteepenPart));
    d = around.moved(d, around.above_middle(d));
  }
  return ops::clip(snap(d, image), 0, 1);
}

}  // namespace slide::graphs
