#pragma once

#include <string>

#include "render/codec.h"

namespace slide {

/// Whether this build reads and writes through OpenImageIO.
[[nodiscard]] bool has_openimageio() noexcept;

/// Reads OpenEXR, TIFF, WebP, HEIF, BMP, GIF, HDR, PNM (all told by their first bytes) or Targa (by .tga),
/// one flat picture of it: 1 to 4 channels (of more, the first ones), alpha not multiplied into the colours.
/// Linear light becomes sRGB-encoded in [0, 1] if `photo`; maps keep their values, and of a map with a
/// channel Z (renderers' depth) that one is read.
/// @throws Error(kBadInput) naming the file if it cannot be read, or if this build is without OpenImageIO
[[nodiscard]] Decoded read_through_openimageio(const std::string& path, bool photo,
                                               const SizeCheck& check = {});

/// Writes 32-bit OpenEXR, losslessly compressed (ZIP), under exactly this name.
/// @throws Error(kOutput) if it cannot be written, Error(kUsage) if this build is without OpenImageIO
void write_exr_unsafely(const std::string& path, const Image& image);

}  // namespace slide
