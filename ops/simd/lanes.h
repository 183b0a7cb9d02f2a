#pragma once

// Lanes moved between vectors. See ops/simd/simd.h for the rules.

#include <utility>

#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA::simd {

template <int... I>
SLIDE_INLINE Float even_lanes(Float a, Float b, std::integer_sequence<int, I...> /*lanes*/) {
  return {__builtin_shufflevector(a.v, b.v, (2 * I)...)};
}
template <int... I>
SLIDE_INLINE Float odd_lanes(Float a, Float b, std::integer_sequence<int, I...> /*lanes*/) {
  return {__builtin_shufflevector(a.v, b.v, (2 * I + 1)...)};
}
template <int First, int... I>
SLIDE_INLINE Float zip_lanes(Float a, Float b, std::integer_sequence<int, I...> /*lanes*/) {
  return {__builtin_shufflevector(a.v, b.v, (First + I / 2 + I % 2 * kWidth)...)};
}
template <int... I>
SLIDE_INLINE Float shifted_lanes(Float a, Float b, std::integer_sequence<int, I...> /*lanes*/) {
  return {__builtin_shufflevector(a.v, b.v, (I + 1)...)};
}
using Lanes = std::make_integer_sequence<int, kWidth>;
/// Lanes 0, 2, ... and 1, 3, ... of a and then b.
SLIDE_INLINE Float even(Float a, Float b) { return even_lanes(a, b, Lanes()); }
SLIDE_INLINE Float odd(Float a, Float b) { return odd_lanes(a, b, Lanes()); }
/// a0 b0 a1 b1 ...: the first kWidth of them, and the rest.
SLIDE_INLINE Float zip_low(Float a, Float b) { return zip_lanes<0>(a, b, Lanes()); }
SLIDE_INLINE Float zip_high(Float a, Float b) { return zip_lanes<kWidth / 2>(a, b, Lanes()); }
/// Lanes 1, 2, ... of a, then `last`.
SLIDE_INLINE Float shift_in(Float a, float last) { return shifted_lanes(a, broadcast(last), Lanes()); }

}  // namespace slide::ops::SLIDE_ISA::simd
