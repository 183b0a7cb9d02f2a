#include "graphs/slide_rim.h"

#include "graphs/layers.h"
#include "graphs/unet.h"
#include "ops/pointwise/pointwise.h"
#include "ops/pool/pool.h"
#include "ops/reduce/reduce.h"
#include "ops/resize/resize.h"
#include "ops/tensor_shape/tensor_shape.h"

namespace slide::graphs {
namespace {

/// The probability of subject that a matte of 0 stands for, and of background that 1 does: so the network can
/// change what the coarse matte is sure of.
constexpr double kDoubt = 0.02;
/// Less than this probability of subject is a matte of 0, more than one minus it is 1: no haze stays.
constexpr double kCertain = 0.08;
constexpr std::int64_t kEighth = 64;  // channels of the U-Net at an eighth of the size, and on its way back
constexpr std::int64_t kLast = 16;
constexpr std::int64_t kMultiple = 8;

/// A matte above 1 - 1/kSure shows the subject's colours, below 1/kSure the background's.
constexpr double kSure = 5;
/// Nearby is a window of kCells × kCells cells of kCell pixels a side.
constexpr std::int64_t kCell = 8;
constexpr std::int64_t kCells = 7;
constexpr double kNone = 0.01;  // so much of nearby has no colour

/// The mean colour of what is nearby and of one kind, and how much there is of it.
struct Nearby {
  Value colour;  ///< 1×3×H×W
  Value amount;  ///< 1×1×H×W in [0, 1]
};

/// @param weight  1×1×H×W in [0, 1]: which pixels are of that kind
Nearby nearby(Value image, Value weight) {
  const auto spread = [](Value x) {
    const Value cells = ops::avg_pool2d(x, {.kernel = {kCell, kCell}, .stride = {kCell, kCell}});
    constexpr std::int64_t kPad = kCells / 2;
    return ops::avg_pool2d(cells, {.kernel = {kCells, kCells},
                                   .stride = {1, 1},
                                   .padding = {kPad, kPad, kPad, kPad},
                                   .count_include_pad = true});
  };
  const auto sized = [&](Value x) {
    return ops::resize_bilinear(x, image.shape()[2], image.shape()[3], false);
  };
  const Value there = spread(weight);
  const Value some = ops::affine(there, 1, kNone);
  return {sized(ops::div(spread(ops::mul(image, weight)), some)), sized(ops::div(there, some))};
}

/// What the network sees, 1×8×H×W: the photo and the matte in [-1, 1]; where each pixel's colour lies between
/// those of background (-1/2) and subject (1/2) nearby, its squared distances to both, and theirs to each
/// other, as far as there are both nearby.
Value network_input(Value image, Value coarse) {
  const Nearby front = nearby(image, ops::clip(ops::affine(coarse, kSure, 1 - kSure), 0, 1));
  const Nearby back = nearby(image, ops::clip(ops::affine(coarse, -kSure, 1), 0, 1));
  const Value both = ops::mul(front.amount, back.amount);
  const auto mean_product = [](Value a, Value b) { return ops::reduce_mean(ops::mul(a, b), {1}); };
  const auto square = [&](Value x) { return ops::affine(ops::mul(both, mean_product(x, x)), 4, 0); };
  const Value step = ops::sub(front.colour, back.colour);
  const Value from_back = ops::sub(image, back.colour);
  const Value apart = ops::affine(mean_product(step, step), 1, kNone);
  const Value way = ops::clip(ops::div(mean_product(from_back, step), apart), -0.5, 1.5);
  return ops::concat(
      {ops::affine(image, 2, -1), ops::affine(coarse, 2, -1), ops::mul(both, ops::affine(way, 1, -0.5)),
       square(ops::sub(image, front.colour)), square(from_back), square(step)},
      1);
}

}  // namespace

Value slide_rim(Value image, Value coarse) {
  require_image("slide_rim", image, 3, kMultiple);
  require_image("slide_rim", coarse, 1, kMultiple);
  const Value change = small_unet(network_input(image, coarse), kEighth, kLast);
  const Value p = ops::affine(coarse, 1 - 2 * kDoubt, kDoubt);
  const Value moved = moved_by_log_odds(p, change);
  const double scale = 1 / (1 - 2 * kCertain);
  return tapped("matte", ops::clip(ops::affine(moved, scale, -kCertain * scale), 0, 1));
}

}  // namespace slide::graphs
