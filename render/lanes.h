#pragma once

#include <cstdint>
#include <cstring>

namespace slide {

// Four lanes at once, in the compilers' portable vector extension (SSE2 and NEON have registers of this
// width). Each lane is computed by the same IEEE operations in the same order on every CPU.
using Float4 __attribute__((vector_size(16))) = float;
using Int4 __attribute__((vector_size(16))) = std::int32_t;

inline Float4 load4(const float* p) {
  Float4 v;
  std::memcpy(&v, p, sizeof v);
  return v;
}
inline void store4(float* p, Float4 v) { std::memcpy(p, &v, sizeof v); }
inline Float4 splat(float x) { return Float4{x, x, x, x}; }
inline Int4 splat(std::int32_t x) { return Int4{x, x, x, x}; }
inline Float4 to_float(Int4 v) { return __builtin_convertvector(v, Float4); }
/// Rounds toward zero; the values must fit.
inline Int4 to_int(Float4 v) { return __builtin_convertvector(v, Int4); }

/// yes where the mask's bits are set, else no. Masks are what comparisons give: all bits or none.
inline Float4 select(Int4 mask, Float4 yes, Float4 no) {
  Int4 y;
  Int4 n;
  std::memcpy(&y, &yes, sizeof y);
  std::memcpy(&n, &no, sizeof n);
  const Int4 bits = (y & mask) | (n & ~mask);
  Float4 result;
  std::memcpy(&result, &bits, sizeof result);
  return result;
}
inline bool any(Int4 mask) {
  std::uint64_t halves[2];
  std::memcpy(halves, &mask, sizeof halves);
  return (halves[0] | halves[1]) != 0;
}
inline Float4 min4(Float4 a, Float4 b) { return select(a < b, a, b); }
inline Float4 max4(Float4 a, Float4 b) { return select(a > b, a, b); }

}  // namespace slide
