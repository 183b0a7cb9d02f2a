#include "render/exif.h"

#include <cmath>
#include <numbers>

namespace slide {
namespace {

enum Tag : std::uint16_t {
  kOrientation = 0x0112,
  kExifIfd = 0x8769,
  kFocalLength = 0x920A,
  kPixelXDimension = 0xA002,
  kFocalPlaneXResolution = 0xA20E,
  kFocalPlaneResolutionUnit = 0xA210,
  kFocalLengthIn35mmFilm = 0xA405,
};

enum Type : std::uint16_t { kShort = 3, kLong = 4, kRational = 5 };

constexpr double kFilmDiagonalMm = 43.266615305567875;  // 36 mm × 24 mm

class TiffReader {
 public:
  explicit TiffReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {
    if (bytes_.size() < 8) return;
    big_endian_ = bytes_[0] == 'M' && bytes_[1] == 'M';
    const bool little_endian = bytes_[0] == 'I' && bytes_[1] == 'I';
    valid_ = (big_endian_ || little_endian) && u16(2) == 42;
  }

  [[nodiscard]] bool valid() const { return valid_; }

  /// Both return 0 outside of the block.
  [[nodiscard]] std::uint16_t u16(std::size_t at) const {
    if (at > bytes_.size() || bytes_.size() - at < 2) return 0;
    const unsigned a = bytes_[at];
    const unsigned b = bytes_[at + 1];
    return static_cast<std::uint16_t>(big_endian_ ? a << 8U | b : b << 8U | a);
  }
  [[nodiscard]] std::uint32_t u32(std::size_t at) const {
    const std::uint32_t a = u16(at);
    const std::uint32_t b = u16(at + 2);
    return big_endian_ ? a << 16U | b : b << 16U | a;
  }

  /// The first value of a SHORT, LONG or RATIONAL entry, NaN for anything else.
  [[nodiscard]] double value(std::size_t entry) const {
    switch (u16(entry + 2)) {
      case kShort:
        return u16(entry + 8);
      case kLong:
        return u32(entry + 8);
      case kRational: {
        const std::size_t at = u32(entry + 8);
        return static_cast<double>(u32(at)) / static_cast<double>(u32(at + 4));
      }
      default:
        return std::nan("");
    }
  }

 private:
  std::span<const std::uint8_t> bytes_;
  bool big_endian_ = false;
  bool valid_ = false;
};

std::optional<double> positive(double value) {
  if (std::isfinite(value) && value > 0) return value;
  return std::nullopt;
}

/// Calls visit(tag, value) for every entry of the IFD at that offset.
template <typename Visit>
void for_each_entry(const TiffReader& tiff, std::size_t ifd, const Visit& visit) {
  constexpr std::size_t kEntryBytes = 12;
  const std::size_t count = tiff.u16(ifd);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t entry = ifd + 2 + i * kEntryBytes;
    visit(tiff.u16(entry), tiff.value(entry));
  }
}

/// Millimetres per FocalPlaneResolutionUnit; the TIFF default is the inch.
double unit_mm(double unit) {
  if (unit == 3) return 10;
  if (unit == 4) return 1;
  if (unit == 5) return 0.001;
  return 25.4;
}

}  // namespace

Exif parse_exif(std::span<const std::uint8_t> tiff) {
  Exif exif;
  const TiffReader reader(tiff);
  if (!reader.valid()) return exif;
  std::optional<double> exif_ifd;
  for_each_entry(reader, reader.u32(4), [&](std::uint16_t tag, double value) {
    if (tag == kOrientation && value >= 1 && value <= 8) exif.orientation = static_cast<int>(value);
    if (tag == kExifIfd) exif_ifd = positive(value);
  });
  if (!exif_ifd) return exif;
  std::optional<double> resolution;
  double unit = 2;
  for_each_entry(reader, static_cast<std::size_t>(*exif_ifd), [&](std::uint16_t tag, double value) {
    if (tag == kFocalLength) exif.focal_length_mm = positive(value);
    if (tag == kFocalLengthIn35mmFilm) exif.focal_length_35mm = positive(value);
    if (tag == kPixelXDimension) exif.plane_width_pixels = positive(value);
    if (tag == kFocalPlaneXResolution) resolution = positive(value);
    if (tag == kFocalPlaneResolutionUnit) unit = value;
  });
  if (resolution) exif.plane_pixels_per_mm = *resolution / unit_mm(unit);
  return exif;
}

std::optional<double> focal_length_pixels(const Exif& exif, int width, int height) {
  const double diagonal = std::hypot(width, height);
  const auto plausible = [diagonal](double focal) {
    const double fov_degrees = 2 * std::atan2(diagonal / 2, focal) * 180 / std::numbers::pi;
    return fov_degrees >= 1 && fov_degrees <= 170;
  };
  if (exif.focal_length_35mm) {
    const double focal = *exif.focal_length_35mm * diagonal / kFilmDiagonalMm;
    if (plausible(focal)) return focal;
  }
  if (exif.focal_length_mm && exif.plane_pixels_per_mm) {
    const double scale = exif.plane_width_pixels ? width / *exif.plane_width_pixels : 1.0;
    const double focal = *exif.focal_length_mm * *exif.plane_pixels_per_mm * scale;
    if (plausible(focal)) return focal;
  }
  return std::nullopt;
}

}  // namespace slide
