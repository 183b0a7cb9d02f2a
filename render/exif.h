#pragma once

#include <cstdint>
#include <optional>
#include <span>

namespace slide {

/// What an image's EXIF block says about how to show it and how it was taken.
struct Exif {
  int orientation = 1;                        ///< 1..8, the Orientation tag; 1 when absent or out of range
  std::optional<double> focal_length_mm;      ///< FocalLength
  std::optional<double> focal_length_35mm;    ///< FocalLengthIn35mmFilm
  std::optional<double> plane_pixels_per_mm;  ///< FocalPlaneXResolution in its unit, as pixels per millimetre
  std::optional<double> plane_width_pixels;   ///< PixelXDimension, the width that resolution speaks of
};

/// Reads an EXIF block, which is a TIFF file in either byte order (Exif 2.32, section 4.5): IFD0 and the Exif
/// IFD. The block is untrusted: whatever is out of bounds, of another type or not a positive number counts as
/// absent; it never fails. Follows no IFD chain, so it ends on any input.
/// @param tiff  the block after the "Exif\0\0" identifier
[[nodiscard]] Exif parse_exif(std::span<const std::uint8_t> tiff);

/// The focal length in pixels of the image as stored (before orientation), or nothing where EXIF does not
/// say: from FocalLengthIn35mmFilm by the diagonal (43.27 mm on 35 mm film, as CIPA DCG-001 defines it), else
/// from FocalLength and FocalPlaneXResolution. Values that mean a diagonal field of view outside [1°, 170°]
/// are ignored.
[[nodiscard]] std::optional<double> focal_length_pixels(const Exif& exif, int width, int height);

}  // namespace slide
