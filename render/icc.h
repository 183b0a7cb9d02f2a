#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "render/image.h"

namespace slide {

/// How a file's values become linear light in sRGB's primaries: a curve for each channel, then a matrix.
struct ColourProfile {
  /// Linear light of the values 0, 1/(n - 1), ..., 1; n >= 2. One curve for grey, three for RGB.
  std::vector<std::vector<double>> curves;
  /// From the profile's linear RGB to sRGB's, row by row. Not used for grey.
  std::array<double, 9> matrix = {1, 0, 0, 0, 1, 0, 0, 0, 1};
};

/// Reads an ICC profile of the kind that cameras, phones and editors embed: RGB by three primaries and
/// curves, or grey by one curve (ICC.1:2022, sections 7.2, 9.2, 10.6 and 10.18, matrix/TRC model F.3).
/// @return nothing for what such a profile is not (tables, CMYK, Lab), for a damaged one, and for sRGB
/// itself:
///   the values are then left as they are
[[nodiscard]] std::optional<ColourProfile> read_icc_profile(std::span<const std::uint8_t> bytes);

/// The profile of values that are a power of linear light in sRGB's primaries, as PNG's gAMA chunk says.
/// @param exponent  what takes linear light to the values, for example 1/2.2; > 0
/// @return nothing for sRGB's own 1/2.2 (0.45455)
[[nodiscard]] std::optional<ColourProfile> gamma_profile(double exponent);

/// The value of sRGB's encoding for linear light (IEC 61966-2-1); clamped to [0, 1], 0 for NaN.
[[nodiscard]] float srgb_from_linear(float linear) noexcept;

/// Turns the colours of an image of 1 to 4 channels into sRGB's, clamped to [0, 1]; alpha stays as it is. A
/// grey image takes the first curve of an RGB profile; a grey profile changes nothing in an RGB image.
void apply_profile(const ColourProfile& profile, Image& image);

}  // namespace slide
