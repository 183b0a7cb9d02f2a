#pragma once

#include <string_view>

namespace slide {

/// "0.2.0"
[[nodiscard]] std::string_view version() noexcept;

/// Compiler, target and options this build was made with: "GCC 12.2.0, x86_64, static, without OpenImageIO".
[[nodiscard]] std::string_view build_description() noexcept;

}  // namespace slide
