#pragma once

#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

namespace slide {

/// The weight files that are part of this program (CMake option SLIDE_EMBED_WEIGHTS): slide_depth,
/// slide_inpaint, slide_matte, slide_rim, each a whole safetensors file, 64-byte aligned. See
/// weights/README.md for what they are.

/// The bytes of a file; empty if this build has none of that name.
[[nodiscard]] std::span<const std::byte> default_weights(std::string_view model) noexcept;

/// The names this build has.
[[nodiscard]] std::vector<std::string_view> default_weight_names();

}  // namespace slide
