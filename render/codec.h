#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "render/exif.h"
#include "render/icc.h"
#include "render/image.h"
#include "render/image_file.h"

namespace slide {

/// What a decoder found in a file, before orientation: 1 to 4 channels (grey, grey+alpha, RGB, RGB+alpha),
/// alpha not multiplied into the colours.
struct Decoded {
  Image image;
  Exif exif;
  std::optional<ColourProfile> profile;  ///< of the colours; nothing for sRGB
};

[[nodiscard]] bool is_jpeg(std::span<const std::uint8_t> bytes) noexcept;
[[nodiscard]] bool is_png(std::span<const std::uint8_t> bytes) noexcept;
[[nodiscard]] bool is_pfm(std::span<const std::uint8_t> bytes) noexcept;

/// Each throws Error(kBadInput) naming `name` for whatever is not a whole file of that format within the
/// limits of image_file.h. Damage that the library would paper over with grey or repeated data is an error
/// too.
[[nodiscard]] Decoded decode_jpeg(std::span<const std::uint8_t> bytes, const std::string& name,
                                  const SizeCheck& check = {});
[[nodiscard]] Decoded decode_png(std::span<const std::uint8_t> bytes, const std::string& name,
                                 const SizeCheck& check = {});

/// Portable float map: one ("Pf") or three ("PF") channels, rows from the bottom up, little-endian where the
/// scale is negative. The magnitude of the scale is not applied.
[[nodiscard]] Image decode_pfm(std::span<const std::uint8_t> bytes, const std::string& name,
                               const SizeCheck& check = {});

/// Baseline JPEG (4:4:4, optimised Huffman tables) of 1 or 3 channels, values clamped to [0, 1].
/// @param quality  1..100, libjpeg's scale
[[nodiscard]] std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality);

/// PNG of 1 to 4 channels with 8 or 16 bits a sample: value · (2^bits - 1), rounded to nearest, clamped; NaN
/// gives 0.
[[nodiscard]] std::vector<std::uint8_t> encode_png(const Image& image, int bits);
/// The same from samples: height rows of width · channels samples, each of bits/8 bytes, most significant
/// first.
[[nodiscard]] std::vector<std::uint8_t> encode_png_samples(int width, int height, int channels, int bits,
                                                           std::span<const std::uint8_t> samples);

/// Little-endian PFM of 1 or 3 channels, the values as they are.
[[nodiscard]] std::vector<std::uint8_t> encode_pfm(const Image& image);

/// Values clamped to [0, 1] (NaN gives 0) as samples of 8 or 16 bits, 16-bit samples most significant byte
/// first.
[[nodiscard]] std::vector<std::uint8_t> to_samples(const Image& image, int bits);

}  // namespace slide
