#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "render/image.h"

namespace slide {

/// A photograph as read from a file, the right way up.
struct Photo {
  Image colour;  ///< H×W×3, [0, 1], sRGB-encoded
  Image alpha;   ///< H×W×1, [0, 1], the file's own transparency; empty where the file is opaque
  std::optional<double> horizontal_fov;  ///< radians, from EXIF; nothing where EXIF does not say
  bool has_depth = false;  ///< the file says that it holds a depth map (render/embedded_depth.h)
  Image disparity;         ///< H×W×1 of a size of its own, that map; empty unless it is there and asked for
};

/// What becomes of a depth map that a photo holds.
enum class EmbeddedMap { kIgnored, kRead };

inline constexpr int kMaxImageSide = 30000;
inline constexpr std::int64_t kMaxImagePixels = std::int64_t{1} << 27;  ///< 134 megapixels

/// Asked with the width and height that a file's header promises, before anything of that size is allocated;
/// refuses by an exception.
using SizeCheck = std::function<void(int width, int height)>;
inline constexpr std::size_t kMaxFileBytes = std::size_t{1} << 30;

/// Reads a photograph. The type is found from the content, not from the name.
///
/// JPEG and PNG are read in every build (libjpeg-turbo, libpng); whatever else OpenImageIO knows in builds
/// with it. 8 and 16 bits, grey, palette, interlaced and progressive files all become RGB. EXIF orientation
/// is applied (all eight cases, in PNG too). Colour profiles (ICC of primaries and curves, PNG's gamma) and
/// linear light, as in OpenEXR, become sRGB, clipped to [0, 1]; other profiles are not applied. Transparent
/// pixels are filled from the opaque ones around (render/cutout.h), and the transparency is kept beside.
///
/// A depth map in the file is turned as the photo is, and the check is asked for its size, too.
///
/// @throws Error(kBadInput) naming the file: missing, truncated or damaged, CMYK, more than kMaxImageSide pixels
///         a side or kMaxImagePixels in all, or of a format this build does not read
/// @throws Error(kOutOfMemory)
[[nodiscard]] Photo read_photo(const std::string& path, const SizeCheck& check = {},
                               EmbeddedMap map = EmbeddedMap::kIgnored);

/// What becomes of NaN and infinity in a map.
enum class NonFinite { kRefused, kKept };

/// Reads a map (depth, disparity, matte): one value per pixel, H×W×1. PNG with 8 or 16 bits and grey JPEG
/// give [0, 1]; PFM (of either byte order) and NumPy's .npy (height×width of floats) give their values as
/// they are; EXR (its channel Z, if it has one) and others through OpenImageIO, in builds with it. Colour
/// files are accepted if their three channels are equal; transparency is ignored. Orientation is applied.
/// @throws Error(kBadInput) as above, and for a NaN or infinite value that is not kept, naming the first such
/// pixel
/// @throws Error(kOutOfMemory)
[[nodiscard]] Image read_map(const std::string& path, NonFinite values = NonFinite::kRefused,
                             const SizeCheck& check = {});

/// Reads a matte, H×W×1: the transparency of a file that has some, else as read_map() does.
[[nodiscard]] Image read_matte(const std::string& path, const SizeCheck& check = {});

/// The same from bytes in memory; `name` is what messages call them. JPEG, PNG and (maps only) PFM.
[[nodiscard]] Photo decode_photo(std::span<const std::uint8_t> bytes, const std::string& name,
                                 const SizeCheck& check = {}, EmbeddedMap map = EmbeddedMap::kIgnored);
[[nodiscard]] Image decode_map(std::span<const std::uint8_t> bytes, const std::string& name);

/// The image turned as the EXIF Orientation tag (1..8) says it should be shown. Other values mean 1.
[[nodiscard]] Image oriented(Image image, int orientation);

/// Refuses sizes outside of the limits above. @throws Error(kBadInput) naming `name`
void check_image_size(std::int64_t width, std::int64_t height, const std::string& name);

/// Refuses a map with NaN or infinity. @throws Error(kBadInput) naming `name` and the first such pixel
void require_finite(const Image& map, const std::string& name);

/// The bytes of a file or of a pipe. @throws Error(kBadInput) if it cannot be read, is a directory or a
/// device, holds more than kMaxFileBytes, or is a pipe that says nothing for ten seconds
[[nodiscard]] std::vector<std::uint8_t> read_file(const std::string& path);

/// The same of what is on standard input.
[[nodiscard]] std::vector<std::uint8_t> read_standard_input();

}  // namespace slide
