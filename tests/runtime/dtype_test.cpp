#include "runtime/dtype.h"

#include <doctest/doctest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

using namespace slide;

TEST_CASE("every half survives the way to float and back") {
  for (std::uint32_t bits = 0; bits < 65536; ++bits) {
    const auto half = static_cast<std::uint16_t>(bits);
    const float value = float_from_half(half);
    if (std::isnan(value))
      CHECK(std::isnan(float_from_half(half_from_float(value))));
    else
      REQUIRE(half_from_float(value) == half);
  }
}

TEST_CASE("float to half rounds to nearest even, checked between every two neighbours") {
  for (std::uint16_t bits = 0; bits < 0x7bff; ++bits) {
    const float low = float_from_half(bits);
    const float high = float_from_half(static_cast<std::uint16_t>(bits + 1));
    const float middle = low + (high - low) / 2;  // exact in float
    const auto even = static_cast<std::uint16_t>((bits & 1u) != 0 ? bits + 1 : bits);
    REQUIRE(half_from_float(middle) == even);
    REQUIRE(half_from_float(std::nextafter(middle, 0.0F)) == bits);
    REQUIRE(half_from_float(std::nextafter(middle, 1e9F)) == bits + 1);
  }
  CHECK(half_from_float(65519.996F) == 0x7bff);
  CHECK(half_from_float(65520.0F) == 0x7c00);
  CHECK(half_from_float(-std::numeric_limits<float>::infinity()) == 0xfc00);
}

TEST_CASE("float to bfloat16 rounds to nearest even and keeps NaN a NaN") {
  for (std::uint32_t bits = 0; bits < 0x7f80; ++bits) {
    const float low = float_from_bfloat16(static_cast<std::uint16_t>(bits));
    const std::uint32_t middle = (bits << 16) | 0x8000u;
    REQUIRE(bfloat16_from_float(low) == bits);
    REQUIRE(bfloat16_from_float(std::bit_cast<float>(middle)) == bits + (bits & 1u));
    REQUIRE(bfloat16_from_float(std::bit_cast<float>(middle - 1)) == bits);
    REQUIRE(bfloat16_from_float(std::bit_cast<float>(middle + 1)) == bits + 1);
  }
  CHECK(std::isnan(float_from_bfloat16(bfloat16_from_float(std::bit_cast<float>(0x7f800001u)))));
}
