#include "runtime/dtype.h"

#include <doctest/doctest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

#include "runtime/tensor.h"

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

TEST_CASE("tensors of float32 widen exactly, those of float64 round to nearest even, unaligned ones too") {
  const float inf = std::numeric_limits<float>::infinity();
  const std::vector<double> wide{1 + 0x1p-24, 1 + 0x1.8p-23, 1 + 0x1p-24 + 0x1p-50, 0x1p-149,
                                 0x1p-150,    -0.0,          0x1.fffffefp127,       -0x1.ffffffp127};
  const std::vector<float> narrow{1, 1 + 0x1p-22F, 1 + 0x1p-23F, 0x1p-149F, 0, -0.0F, 0x1.fffffep127F, -inf};
  const Tensor t = Tensor::from<double>({8}, std::span<const double>(wide)).to(DType::kF32);
  const Tensor back = t.to(DType::kF64);
  std::vector<std::byte> bytes(8 * sizeof(double) + 1);
  std::memcpy(bytes.data() + 1, wide.data(), 8 * sizeof(double));
  const Tensor unaligned = Tensor::view(DType::kF64, {8}, bytes.data() + 1).to(DType::kF32);
  for (std::size_t i = 0; i < 8; ++i) {
    CHECK(std::bit_cast<std::uint32_t>(t.data<float>()[i]) == std::bit_cast<std::uint32_t>(narrow[i]));
    CHECK(std::bit_cast<std::uint32_t>(unaligned.data<float>()[i]) ==
          std::bit_cast<std::uint32_t>(narrow[i]));
    CHECK(back.data<double>()[i] == static_cast<double>(narrow[i]));
  }
}
