#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "render/image.h"

namespace slide {

/// Each writes a file that appears under its name only when it is complete (runtime/atomic_file.h).
/// @throws Error(kOutput) naming the file if it cannot be written

void write_bytes(const std::string& path, std::span<const std::uint8_t> bytes);
/// 1 to 4 channels of 8 or 16 bits; values are clamped to [0, 1], NaN becomes 0.
void write_png(const std::string& path, const Image& image, int bits = 8);
/// 1 or 3 channels, 4:4:4; values are clamped to [0, 1], NaN becomes 0.
void write_jpeg(const std::string& path, const Image& image, int quality = 92);
/// 32-bit floats, 1 or 3 channels, the values as they are.
void write_pfm(const std::string& path, const Image& image);
/// 32-bit floats, the values as they are; only in builds with OpenImageIO, Error(kUsage) in others.
void write_exr(const std::string& path, const Image& image);

/// A still image in the format its name ends with: .png (8 bits), .jpg or .jpeg, .pfm, .exr; case does not
/// matter.
/// @throws Error(kUsage) naming these for any other name
void write_image(const std::string& path, const Image& image);

/// The part of a file name from its last dot, in lower case (".png"); empty where there is none.
[[nodiscard]] std::string lower_extension(const std::string& path);

}  // namespace slide
