#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace slide {

/// Adobe's metadata in JPEG files (ISO 16684-1; XMP specification, part 3, section 1.1.3). All of it is
/// untrusted: nothing here fails, what is damaged counts as absent, and nothing grows beyond the file.

/// The first XMP packet of a JPEG, and after it the extended packet that it names, put together from its
/// parts as far as they come without a gap. Empty if there is none.
[[nodiscard]] std::string xmp_of_jpeg(std::span<const std::uint8_t> jpeg);

/// The value of a property by its usual name ("GDepth:Near"), written as an attribute or as an element, the
/// first one there is; empty if there is none. Character references are left as they are.
[[nodiscard]] std::string_view xmp_property(std::string_view xmp, std::string_view name);

/// How many bytes the first picture of a JPEG file takes, its end marker included; all if that is missing.
[[nodiscard]] std::size_t jpeg_picture_bytes(std::span<const std::uint8_t> jpeg);

}  // namespace slide
