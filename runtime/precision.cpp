#include "runtime/precision.h"

#include <array>
#include <utility>

namespace slide {
namespace {

constexpr std::array kNames = {std::pair{Precision::kFp32, "fp32"}, std::pair{Precision::kBf16, "bf16"},
                               std::pair{Precision::kInt8, "int8"}};

}  // namespace

std::string_view name_of(Precision precision) noexcept {
  for (const auto& [value, name] : kNames)
    if (value == precision) return name;
  return "";
}

std::optional<Precision> precision_from_name(std::string_view name) noexcept {
  for (const auto& [value, text] : kNames)
    if (text == name) return value;
  return std::nullopt;
}

}  // namespace slide
