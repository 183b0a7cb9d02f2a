#include "graphs/subject.h"

#include "graphs/neighbourhood.h"
#include "ops/fill/fill.h"
#include "ops/matting/foreground.h"
#include "ops/pointwise/pointwise.h"
#include "ops/tensor_shape/tensor_shape.h"

namespace slide::graphs {
namespace {

/// Lengths as parts of the longer side: how far a matte counts, and how wide gaps in hair are closed.
constexpr double kReachPart = 1.0 / 60;
constexpr double kGapPart = 1.0 / 160;
/// M from which a pixel is the subject's alone, and up to which it is the background's.
constexpr double kSubject = 0.95;
constexpr double kAround = 0.05;
/// M from which a pixel is in the subject's layer.
constexpr double kInSubject = 0.02;
/// How far a pixel near the outline counts for the disparity of its side.
constexpr double kNearOutline = 1e-8;
constexpr double kRim = 0.1;
/// The subject stands out by a step of disparity from the one on, wholly from the other.
constexpr double kLevel = 0.06;
constexpr double kStep = 0.12;
/// Parts of a window that matte and disparity may disagree in.
constexpr double kSame = 0.25;
constexpr double kDifferent = 0.4;
/// M from which a pixel says nothing of the background, and up to which it says all.
constexpr double kCovered = 0.9;
constexpr double kHalfOpen = 0.5;
constexpr int kSweeps = 4;

Value complement(Value x) { return ops::affine(x, -1, 1); }

/// a + part·(b - a)
Value between(Value a, Value b, Value part) { return ops::add(a, ops::mul(part, ops::sub(b, a))); }

/// The disparity of the pixels where `side` is 1, continued over the others.
Value continued(Value disparity, Value side, std::int64_t radius) {
  const Value sure = least_around(side, radius);
  const Value weight = ops::add(ops::affine(sure, 1 - kNearOutline, 0), ops::affine(side, kNearOutline, 0));
  return ops::push_pull_fill(disparity, weight, kSweeps);
}

/// 1 within `radius` pixels of where the matte is soft or jumps.
Value near_rim(Value matte, std::int64_t radius) {
  const Value soft = ops::affine(ops::mul(matte, complement(matte)), 4, 0);
  const Value steep = ops::sub(largest_around(matte, 1), least_around(matte, 1));
  return largest_around(ops::greater(ops::maximum(soft, steep), kRim), radius);
}

}  // namespace

SubjectRim find_subject(Value image, Value disparity, Value matte) {
  const auto scope = image.graph().scope("subject");
  const std::int64_t radius = pixels_of(matte, kReachPart);
  const Value near = continued(disparity, ops::greater(matte, kSubject), radius);
  const Value far = continued(disparity, complement(ops::greater(matte, kAround)), radius);
  const Value gap = ops::sub(near, far);
  const Value before_middle = ops::greater(ops::sub(ops::affine(disparity, 2, 0), ops::add(near, far)), 0);
  const Value differs = ops::abs(ops::sub(before_middle, ops::greater(matte, 0.5)));
  const Value same = complement(smoothstep(smooth_mean(differs, radius), kSame, kDifferent));
  const Value e = ops::mul(near_rim(matte, radius), ops::mul(smoothstep(gap, kLevel, kStep), same));

  const Value layer = largest_around(ops::greater(matte, kInSubject), pixels_of(matte, kGapPart));
  const Value moves = ops::mul(e, layer);
  const Value nearer = ops::maximum(disparity, near), farther = ops::minimum(disparity, far);
  const auto jumping_at = [&](Value outline) {
    return ops::clip(between(disparity, between(farther, nearer, outline), e), 0, 1);
  };
  const Value colours = ops::foreground_colours(image, matte);
  const Value front = ops::slice(colours, 1, 0, 3);
  const Value open = ops::clip(complement(matte), 1 - kCovered, 1);
  const Value unmixed = ops::clip(ops::div(ops::sub(image, ops::mul(matte, front)), open), 0, 1);
  const Value shown = complement(ops::greater(matte, kCovered));
  const Value clear =
      ops::clip(ops::affine(matte, -1 / (kCovered - kHalfOpen), kCovered / (kCovered - kHalfOpen)), 0, 1);
  return {.agreement = e,
          .moves = moves,
          .disparity = jumping_at(layer),
          .opaque = jumping_at(ops::greater(matte, kOpaque)),
          .front = between(image, front, moves),
          .behind = between(image, unmixed, ops::mul(e, shown)),
          .clear = clear};
}

}  // namespace slide::graphs
