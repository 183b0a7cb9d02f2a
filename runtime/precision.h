#pragma once

#include <optional>
#include <string_view>

namespace slide {

/// What the products of convolutions are computed with. Sums are float32 (of integers exact), and all other
/// operators are computed in float32.
enum class Precision : int {
  kFp32,
  kBf16,  ///< weights and activations rounded to bfloat16, 8 significant bits
  kInt8,  ///< weights to 8 bits per output channel, activations to 8 bits per tensor
};

/// "fp32", "bf16", "int8".
[[nodiscard]] std::string_view name_of(Precision precision) noexcept;
[[nodiscard]] std::optional<Precision> precision_from_name(std::string_view name) noexcept;

}  // namespace slide
