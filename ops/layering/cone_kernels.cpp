// Dilation by a cone along a line in three steps an element, whatever the radius m: the window maximum of
// van Herk ("A fast algorithm for local minimum and maximum filters", 1992) and Gil and Werman (1993), with the
// candidates' order taken from the cone. Look at the window to one side, the m + 1 elements up to p. The line
// is cut into blocks of m + 1 elements; the window is the end of one block and the beginning of the next.
// Each block's best candidate from every element to the block's end (backward pass, stored) and from the
// block's beginning to every element (forward pass, kept in registers) give the result as the better of two.
//
// A candidate is a pair (x(i), i). Of two candidates i < j the one that is better at j is better at every
// later p, since both fall by rho an element. So passes carry candidates, not values, and a value x(i) -
// rho·(p - i) is computed from the winner itself, with one fused rounding (two on the baseline level), never
// by adding up steps.
//
// Near ties. A pass replaces the candidate it holds only if the new one is better after rounding. Rounding is
// monotone, so with a fused operation it is then at least as good in truth, and what is held never gets
// worse; a candidate that is passed over loses at most the rounding of one comparison, and these losses do
// not add up over the line. Without a fused operation a replacement may lose u·rho·K, K the distance between
// the two candidates; these distances add up to at most the winner's own.
//
// NaN wins every comparison and is kept; a block that holds one lies within all windows that see it.
//
// Lanes are lines: whole columns, or rows that the caller has transposed.

#include "ops/layering/cone_kernel.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::broadcast;
using simd::Float;
using simd::kWidth;

constexpr std::size_t kVectors = kConeLanes / kWidth;

/// Candidates of kConeLanes lines at once: value and position along the line, as a distance from a common
/// origin.
struct Candidates {
  Float value[kVectors];
  Float place[kVectors];
};

/// Holds the elements at the origin of a pass.
SLIDE_INLINE void begin_at(const float* origin, Candidates& best) {
  for (std::size_t v = 0; v < kVectors; ++v) {
    best.value[v] = simd::load(origin + v * kWidth);
    best.place[v] = simd::zero<>();
  }
}

/// v - rho·distance, `minus_rho` = -rho.
SLIDE_INLINE Float fallen(Float v, Float distance, Float minus_rho) { return fma(minus_rho, distance, v); }

/// Whether a new value beats what is held; NaN beats all and is beaten by nothing.
SLIDE_INLINE simd::FloatMask beats(Float challenger, Float held) {
  return (held < challenger) | simd::is_nan(challenger);
}

/// Better of two values, NaN if either is.
SLIDE_INLINE Float better(Float a, Float b) { return select(beats(a, b), a, b); }

/// Window maxima to one side. Element k of the line lies at x + k·step, k = 0 .. length - 1; the window of p
/// are the elements p - radius .. p. The results are joined with what is in y, or replace it where `first`.
template <bool First>
SLIDE_INLINE void one_side(const float* x, std::ptrdiff_t step, std::size_t length, std::size_t radius,
                           float rho, float* y, float* scratch) {
  const Float minus_rho = broadcast<>(-rho);
  const std::size_t block = radius + 1;
  float* const suffix_value = scratch;                       // of the block before
  float* const suffix_place = scratch + block * kConeLanes;  // distance from that block's last element
  for (std::size_t start = 0; start < length; start += block) {
    const std::size_t end = length - start < block ? length : start + block;
    Candidates best;
    begin_at(x + static_cast<std::ptrdiff_t>(start) * step, best);
    for (std::size_t p = start; p < end; ++p) {
      const float* from = x + static_cast<std::ptrdiff_t>(p) * step;
      float* to = y + static_cast<std::ptrdiff_t>(p) * step;
      const Float here = broadcast<>(static_cast<float>(p - start));
      for (std::size_t v = 0; v < kVectors; ++v) {
        const Float challenger = simd::load(from + v * kWidth);
        const Float held = fallen(best.value[v], here - best.place[v], minus_rho);
        const simd::FloatMask wins = beats(challenger, held);
        best.value[v] = select(wins, challenger, best.value[v]);
        best.place[v] = select(wins, here, best.place[v]);
        Float result = select(wins, challenger, held);
        if (start > 0 && p + 1 < start + block) {  // the window reaches p - radius, in the block before
          const std::size_t at = (p + 1 - start) * kConeLanes + v * kWidth;
          const Float distance = here + broadcast<>(1.0F) + simd::load(suffix_place + at);
          result = better(fallen(simd::load(suffix_value + at), distance, minus_rho), result);
        }
        if (!First) result = better(simd::load(to + v * kWidth), result);
        simd::store(to + v * kWidth, result);
      }
    }
    if (end == length) return;
    begin_at(x + static_cast<std::ptrdiff_t>(end - 1) * step, best);
    for (std::size_t p = end; p-- > start;) {
      const float* from = x + static_cast<std::ptrdiff_t>(p) * step;
      const Float here = broadcast<>(static_cast<float>(end - 1 - p));
      for (std::size_t v = 0; v < kVectors; ++v) {
        const Float challenger = simd::load(from + v * kWidth);
        const simd::FloatMask wins =
            beats(fallen(challenger, here - best.place[v], minus_rho), best.value[v]);
        best.value[v] = select(wins, challenger, best.value[v]);
        best.place[v] = select(wins, here, best.place[v]);
        simd::store(suffix_value + (p - start) * kConeLanes + v * kWidth, best.value[v]);
        simd::store(suffix_place + (p - start) * kConeLanes + v * kWidth, best.place[v]);
      }
    }
  }
}

}  // namespace

void cone_lines(const float* x, std::size_t length, std::size_t radius, float rho, float* y, float* scratch) {
  const auto step = static_cast<std::ptrdiff_t>(kConeLanes);
  const std::ptrdiff_t last = (static_cast<std::ptrdiff_t>(length) - 1) * step;
  one_side<true>(x, step, length, radius, rho, y, scratch);
  one_side<false>(x + last, -step, length, radius, rho, y + last, scratch);
}

}  // namespace slide::ops::SLIDE_ISA
