#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace slide {

/// Element types a tensor or a weight file may hold. Names are those of the safetensors format.
enum class DType : std::uint8_t { kF64, kF32, kF16, kBF16, kI64, kI32, kI16, kI8, kU8, kBool };

/// Bytes per element.
[[nodiscard]] std::size_t size_of(DType type) noexcept;

/// The safetensors name: "F64", "F32", "F16", "BF16", "I64", "I32", "I16", "I8", "U8", "BOOL".
[[nodiscard]] std::string_view name_of(DType type) noexcept;

/// The type of a safetensors name, or nothing if the name is unknown.
[[nodiscard]] std::optional<DType> dtype_from_name(std::string_view name) noexcept;

/// IEEE binary16 to binary32; exact, infinities and NaN included.
[[nodiscard]] float float_from_half(std::uint16_t bits) noexcept;
/// binary32 to binary16, round to nearest even; overflow gives infinity, NaN stays NaN.
[[nodiscard]] std::uint16_t half_from_float(float value) noexcept;
/// bfloat16 to binary32; exact.
[[nodiscard]] float float_from_bfloat16(std::uint16_t bits) noexcept;
/// binary32 to bfloat16, round to nearest even; NaN stays NaN.
[[nodiscard]] std::uint16_t bfloat16_from_float(float value) noexcept;

/// The DType of a C++ element type; float16 and bfloat16 are raw `uint16_t` and have none.
template <typename T>
struct DTypeOf;
template <>
struct DTypeOf<double> {
  static constexpr DType value = DType::kF64;
};
template <>
struct DTypeOf<float> {
  static constexpr DType value = DType::kF32;
};
template <>
struct DTypeOf<std::int64_t> {
  static constexpr DType value = DType::kI64;
};
template <>
struct DTypeOf<std::int32_t> {
  static constexpr DType value = DType::kI32;
};
template <>
struct DTypeOf<std::int8_t> {
  static constexpr DType value = DType::kI8;
};
template <>
struct DTypeOf<std::uint8_t> {
  static constexpr DType value = DType::kU8;
};

}  // namespace slide
