#include "graphs/edges.h"

#include <algorithm>
#include <cmath>
#include <vector>

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
/// How far, of the longer side, the near side may grow over pixels that are unlike the background, and how many
/// times the background's variance (and noise) the square of their difference is at least.
constexpr double kGrowPart = 1.0 / 250;
constexpr double kUnlike = 9;
/// Weight of a pixel that no jump is near: nothing is divided by zero.
constexpr double kLeastWeight = 1e-9;

/// Of find_jumps(): lines looked at, a large jump's part of the map's range.
constexpr std::int64_t kMostLines = 512;
constexpr double kLargeJump = 0.08;
constexpr std::int64_t kLeastRadius = 3;
/// Of has_soft_edges(): fewer jumps say nothing; pixels that a sharp jump takes at most, and as part of W.
constexpr std::int64_t kLeastJumps = 50;
constexpr double kSharpPixels = 3;
constexpr double kSharpPart = 1.0 / 400;

/// The values of one row or column of a map.
struct MapLine {
  const float* first;
  std::int64_t stride, count;
  [[nodiscard]] double at(std::int64_t i) const { return static_cast<double>(first[i * stride]); }
  [[nodiscard]] double step(std::int64_t i) const { return std::fabs(at(i + 1) - at(i)); }
};

/// Whether step i, from pixel i to i + 1, is the steepest within `radius`, the first of several.
bool is_steepest(const MapLine& line, std::int64_t i, std::int64_t radius) {
  const double step = line.step(i);
  for (std::int64_t j = std::max<std::int64_t>(0, i - radius); j < i; ++j)
    if (line.step(j) >= step) return false;
  for (std::int64_t j = i + 1; j <= std::min(i + radius, line.count - 2); ++j)
    if (line.step(j) > step) return false;
  return true;
}

/// Adds the pixels that each large jump of a line takes.
void add_jumps(const MapLine& line, std::int64_t radius, double large, std::vector<double>& pixels) {
  const double least_step = large / static_cast<double>(2 * radius + 1);  // or the range is smaller
  for (std::int64_t i = 0; i + 1 < line.count; ++i) {
    if (!(line.step(i) >= least_step) || !is_steepest(line, i, radius)) continue;
    double low = line.at(i);
    double high = low;
    for (std::int64_t j = std::max<std::int64_t>(0, i - radius);
         j <= std::min(i + 1 + radius, line.count - 1); ++j) {
      low = std::min(low, line.at(j));
      high = std::max(high, line.at(j));
    }
    if (high - low >= large) pixels.push_back((high - low) / line.step(i));
  }
}

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

/// Step 4.
Value grow(Value d, Value image) {
  const std::int64_t radius = pixels_of(d, kSnapPart);
  const std::int64_t reach = pixels_of(d, kGrowPart);
  const Surroundings around(d, radius);
  const Value near = around.above_middle(d);
  const Value grown = largest_around(near, reach);
  const Value squares = sum_of_planes(ops::mul(image, image));
  const SideColours back(image, squares, ops::mul(ops::affine(grown, -1, 1), around.jump), radius);
  const Value unlike = ops::greater(ops::sub(squared_distance(image, back.mean),
                                             ops::affine(back.variance, kUnlike, kUnlike * kColourNoise)),
                                    0);
  const Value joined = ops::maximum(near, ops::mul(grown, unlike));
  const Value majority = ops::greater(mean_around(joined, pixels_of(d, kMedianPart)), 0.5);
  return around.moved(d, ops::maximum(near, majority));
}

}  // namespace

Value sharpen_edges(Value disparity, Value image) {
  const auto scope = disparity.graph().scope("edges");
  Value d = ops::median(disparity, pixels_of(disparity, kMedianPart));
  for (int pass = 0; pass < kSteepenPasses; ++pass) {
    const Surroundings around(d, pixels_of(d, kSteepenPart));
    d = around.moved(d, around.above_middle(d));
  }
  return ops::clip(grow(snap(d, image), image), 0, 1);
}

Jumps find_jumps(const Tensor& disparity) {
  const std::int64_t height = disparity.shape()[2];
  const std::int64_t width = disparity.shape()[3];
  const float* map = disparity.data<float>().data();
  const auto [low, high] = std::ranges::minmax(disparity.data<float>());
  const double large = kLargeJump * (static_cast<double>(high) - static_cast<double>(low));
  if (!(large > 0)) return {0, 0};
  const auto radius = std::max(
      kLeastRadius,
      static_cast<std::int64_t>(std::llround(static_cast<double>(std::max(width, height)) * kSteepenPart)));
  const auto every = [](std::int64_t lines) { return (lines + kMostLines - 1) / kMostLines; };
  std::vector<double> pixels;
  for (std::int64_t y = 0; y < height; y += every(height))
    add_jumps({map + y * width, 1, width}, radius, large, pixels);
  for (std::int64_t x = 0; x < width; x += every(width))
    add_jumps({map + x, width, height}, radius, large, pixels);
  if (pixels.empty()) return {0, 0};
  const auto middle = pixels.begin() + static_cast<std::ptrdiff_t>((pixels.size() - 1) / 2);
  std::ranges::nth_element(pixels, middle);
  return {*middle, static_cast<std::int64_t>(pixels.size())};
}

bool has_soft_edges(const Tensor& disparity) {
  const auto longer = static_cast<double>(std::max(disparity.shape()[2], disparity.shape()[3]));
  const Jumps jumps = find_jumps(disparity);
  return jumps.count >= kLeastJumps && jumps.pixels > std::max(kSharpPixels, longer * kSharpPart);
}

}  // namespace slide::graphs
