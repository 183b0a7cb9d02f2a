// Operations and their order are the same at every level, so that all give the same numbers.

#include "ops/matting/foreground_op.h"
#include "ops/matting/foreground_routines.h"
#include "ops/simd/partial.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::broadcast;
using simd::Float;
using simd::kWidth;
using simd::load_some;
using simd::store_some;

/// Up to kWidth pixels of a row from column `here` on; their neighbours start at `left` and `right`.
struct Columns {
  std::int64_t here, left, right, count;
};

/// The four neighbours' values: above, below, left, right.
struct Neighbours {
  Float above, below, left, right;

  SLIDE_INLINE Neighbours(const std::array<const float*, 3>& rows, const Columns& c)
      : above(load_some(rows[0] + c.here, c.count)),
        below(load_some(rows[2] + c.here, c.count)),
        left(load_some(rows[1] + c.left, c.count)),
        right(load_some(rows[1] + c.right, c.count)) {}
};

/// What all channels of some pixels share.
struct Weights {
  Float alpha, rest;
  Float above, below, left, right;
  Float one_over_sum, to_front, to_behind;  // 1/d, alpha/q, (1 - alpha)/q

  SLIDE_INLINE Weights(const std::array<const float*, 3>& rows, const Columns& c)
      : alpha(load_some(rows[1] + c.here, c.count)), rest(broadcast(1.0F) - alpha) {
    const Neighbours a(rows, c);
    above = weight(a.above);
    below = weight(a.below);
    left = weight(a.left);
    right = weight(a.right);
    const Float sum = (above + below) + (left + right);
    const Float one_over_q = broadcast(1.0F) / ((alpha * alpha + rest * rest) + sum);
    one_over_sum = broadcast(1.0F) / sum;
    to_front = alpha * one_over_q;
    to_behind = rest * one_over_q;
  }
  [[nodiscard]] SLIDE_INLINE Float mean(const Neighbours& x) const {
    return ((above * x.above + below * x.below) + (left * x.left + right * x.right)) * one_over_sum;
  }

 private:
  [[nodiscard]] SLIDE_INLINE Float weight(Float other) const {
    const Float step = alpha - other;
    return simd::max(step, -step) + broadcast(static_cast<float>(kSmoothness));
  }
};

/// In this order NaN comes through.
SLIDE_INLINE Float clipped(Float x) { return simd::min(broadcast(1.0F), simd::max(broadcast(0.0F), x)); }

SLIDE_INLINE void improve_some(const ForegroundRow& row, const ForegroundChannel* channels,
                               std::int64_t count, const Columns& c) {
  const Weights w(row.alpha, c);
  for (std::int64_t k = 0; k < count; ++k) {
    const ForegroundChannel& channel = channels[k];
    const Float f = w.mean(Neighbours(channel.front, c));
    const Float b = w.mean(Neighbours(channel.behind, c));
    const Float r = load_some(channel.image + c.here, c.count) - w.alpha * f - w.rest * b;
    store_some(channel.improved_front + c.here, clipped(f + w.to_front * r), c.count);
    store_some(channel.improved_behind + c.here, clipped(b + w.to_behind * r), c.count);
  }
}

void improve(const ForegroundRow& row, const ForegroundChannel* channels, std::int64_t count) {
  const std::int64_t last = row.width - 1;
  improve_some(row, channels, count, {0, 0, last > 0 ? 1 : 0, 1});
  for (std::int64_t j = 1; j < last; j += kWidth)
    improve_some(row, channels, count, {j, j - 1, j + 1, last - j < kWidth ? last - j : kWidth});
  if (last > 0) improve_some(row, channels, count, {last, last - 1, last, 1});
}

}  // namespace

extern const ForegroundRoutines foreground;
const ForegroundRoutines foreground{Isa::SLIDE_ISA_ENUM, improve};

}  // namespace slide::ops::SLIDE_ISA
