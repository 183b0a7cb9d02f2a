#pragma once

#include <bit>
#include <cstdint>

namespace slide::ops {

/// The nearest bfloat16, ties to even; NaN stays NaN.
inline std::uint32_t bf16_bits(float x) {
  const auto bits = std::bit_cast<std::uint32_t>(x);
  if (x != x) return bits >> 16U | 0x40U;
  return (bits + 0x7FFFU + (bits >> 16U & 1U)) >> 16U;
}

}  // namespace slide::ops
