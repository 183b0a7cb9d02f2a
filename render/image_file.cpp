#include "render/image_file.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <exception>
#include <memory>
#include <new>
#include <system_error>

#include "ops/npy.h"
#include "render/codec.h"
#include "render/cutout.h"
#include "render/embedded_depth.h"
#include "render/oiio.h"
#include "runtime/error.h"

namespace slide {
namespace {

[[noreturn]] void unreadable(const std::string& path, int code) {
  throw Error(ErrorKind::kBadInput, "cannot read " + path + ": " + std::generic_category().message(code));
}

[[noreturn]] void out_of_memory(const std::string& name) {
  throw Error(ErrorKind::kOutOfMemory, "no memory to read " + name, "use a smaller image");
}

/// A file that is closed in the end.
class Descriptor {
 public:
  explicit Descriptor(int number) noexcept : number_(number) {}
  ~Descriptor() {
    if (number_ >= 0) ::close(number_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  [[nodiscard]] int get() const noexcept { return number_; }

 private:
  int number_;
};

/// Whether it is a pipe rather than a file; refuses folders and devices, which have no end.
bool is_pipe(int file, const std::string& path) {
  struct stat status {};
  if (::fstat(file, &status) != 0) unreadable(path, errno);
  if (S_ISDIR(status.st_mode)) unreadable(path, EISDIR);
  if (S_ISFIFO(status.st_mode) || S_ISSOCK(status.st_mode)) return true;
  if (!S_ISREG(status.st_mode)) throw Error(ErrorKind::kBadInput, path + " is a device, not a file");
  return false;
}

/// Waits until a pipe has something to read or has ended.
void wait_for(int file, const std::string& path) {
  constexpr int kMilliseconds = 10000;
  pollfd wanted{file, POLLIN, 0};
  if (::poll(&wanted, 1, kMilliseconds) == 0)
    throw Error(ErrorKind::kBadInput, path + " is a pipe that nothing came from for ten seconds");
}

/// All that comes from an open file or pipe.
std::vector<std::uint8_t> read_all(int file, const std::string& name) {
  const bool pipe = is_pipe(file, name);
  constexpr std::size_t kStep = std::size_t{1} << 20U;
  std::vector<std::uint8_t> bytes;
  try {
    for (std::size_t filled = 0;;) {
      bytes.resize(filled + kStep);
      if (pipe) wait_for(file, name);
      const ssize_t n = ::read(file, bytes.data() + filled, kStep);
      if (n < 0 && (errno == EINTR || errno == EAGAIN)) continue;
      if (n < 0) unreadable(name, errno);
      filled += static_cast<std::size_t>(n);
      if (filled > kMaxFileBytes) throw Error(ErrorKind::kBadInput, name + " is larger than 1 GiB");
      if (n > 0) continue;
      bytes.resize(filled);
      return bytes;
    }
  } catch (const std::bad_alloc&) {
    out_of_memory(name);
  }
}

bool is_npy(std::span<const std::uint8_t> bytes) {
  constexpr std::array<std::uint8_t, 6> kMagic = {0x93, 'N', 'U', 'M', 'P', 'Y'};
  return bytes.size() > kMagic.size() && std::equal(kMagic.begin(), kMagic.end(), bytes.begin());
}

/// An array of NumPy's as a map: two axes longer than 1, height and width, in this order.
Image map_from_array(const Tensor& array, const std::string& name, const SizeCheck& check) {
  std::vector<std::int64_t> extents;
  for (int i = 0; i < array.shape().rank(); ++i)
    if (array.shape()[i] != 1) extents.push_back(array.shape()[i]);
  if (extents.size() != 2)
    throw Error(ErrorKind::kBadInput,
                name + " has the shape " + array.shape().text() + ", not height x width",
                "save one map of two axes");
  check_image_size(extents[1], extents[0], name);
  if (check) check(static_cast<int>(extents[1]), static_cast<int>(extents[0]));
  Image map(static_cast<int>(extents[1]), static_cast<int>(extents[0]), 1);
  const Tensor values = array.to(DType::kF32);
  std::copy_n(values.data<float>().data(), map.data.size(), map.data.begin());
  return map;
}

/// What a reader throws that is neither an Error nor a lack of memory.
[[noreturn]] void failed(const std::string& name, const std::exception& e) {
  throw Error(ErrorKind::kBadInput, name + " cannot be read as an image: " + e.what());
}

/// What `read` gives; whatever it throws becomes an Error that names the file.
template <typename Read>
auto guarded(const std::string& name, const Read& read) -> decltype(read()) {
  try {
    return read();
  } catch (const std::bad_alloc&) {
    out_of_memory(name);
  } catch (const Error&) {
    throw;
  } catch (const std::exception& e) {
    failed(name, e);
  }
}

/// JPEG and PNG by their content, nothing for other formats.
std::optional<Decoded> decode_known(std::span<const std::uint8_t> bytes, const std::string& name,
                                    const SizeCheck& check = {}) {
  if (is_jpeg(bytes)) return decode_jpeg(bytes, name, check);
  if (is_png(bytes)) return decode_png(bytes, name, check);
  return std::nullopt;
}

[[noreturn]] void unknown_format(const std::string& name) {
  throw Error(ErrorKind::kBadInput, name + " is neither a JPEG nor a PNG file",
              "convert it to one of them; other formats are read from files only");
}

/// One channel of an interleaved image.
Image channel_of(const Image& image, int channel) {
  Image out(image.width, image.height, 1);
  for (std::size_t i = 0; i < out.data.size(); ++i) {
    out.data[i] =
        image.data[i * static_cast<std::size_t>(image.channels) + static_cast<std::size_t>(channel)];
  }
  return out;
}

/// Three equal channels of grey, or the colours without alpha.
Image colours_of(const Image& image) {
  const bool grey = image.channels <= 2;
  Image out(image.width, image.height, 3);
  const auto channels = static_cast<std::size_t>(image.channels);
  for (std::size_t i = 0; i < image.pixels(); ++i)
    for (std::size_t c = 0; c < 3; ++c) out.data[3 * i + c] = image.data[channels * i + (grey ? 0 : c)];
  return out;
}

/// Transparency, the right way round; empty where there is none.
Image alpha_of(const Decoded& decoded) {
  const Image& stored = decoded.image;
  if (stored.channels != 2 && stored.channels != 4) return {};
  Image alpha = channel_of(stored, stored.channels - 1);
  if (std::all_of(alpha.data.begin(), alpha.data.end(), [](float a) { return a >= 1; })) return {};
  return oriented(std::move(alpha), decoded.exif.orientation);
}

Photo to_photo(Decoded decoded, const std::string& name) {
  const std::optional<double> focal =
      focal_length_pixels(decoded.exif, decoded.image.width, decoded.image.height);
  for (const float v : decoded.image.data) {
    if (!std::isfinite(v)) throw Error(ErrorKind::kBadInput, name + " holds NaN or infinite colours");
  }
  if (decoded.profile) apply_profile(*decoded.profile, decoded.image);
  Photo photo;
  photo.alpha = alpha_of(decoded);
  photo.colour = oriented(colours_of(decoded.image), decoded.exif.orientation);
  if (!photo.alpha.empty()) photo.colour = over_own_colours(photo.colour, photo.alpha);
  if (focal) photo.horizontal_fov = 2 * std::atan2(photo.colour.width / 2.0, *focal);
  return photo;
}

void require_equal_channels(const Image& image, const std::string& name) {
  if (image.channels < 3) return;
  const auto channels = static_cast<std::size_t>(image.channels);
  for (std::size_t i = 0; i < image.pixels(); ++i) {
    const float* p = image.data.data() + channels * i;
    // Lossy files and converters leave the channels of a grey picture a step or two apart.
    constexpr float kSteps = 2.5F / 255;
    if (std::fabs(p[0] - p[1]) <= kSteps && std::fabs(p[1] - p[2]) <= kSteps &&
        std::fabs(p[0] - p[2]) <= kSteps)
      continue;
    if (std::isnan(p[0])) continue;  // named by require_finite
    throw Error(ErrorKind::kBadInput, name + " is a colour image; a map needs one value per pixel",
                "save it as a grey image");
  }
}

Image to_map(Decoded decoded, const std::string& name, NonFinite values = NonFinite::kRefused) {
  require_equal_channels(decoded.image, name);
  Image map = oriented(decoded.image.channels == 1 ? std::move(decoded.image) : channel_of(decoded.image, 0),
                       decoded.exif.orientation);
  if (values == NonFinite::kRefused) require_finite(map, name);
  return map;
}

/// The depth map that a photo's file holds, turned as the photo is; empty if it holds none.
Image embedded_disparity(std::span<const std::uint8_t> photo, int orientation, const std::string& name,
                         const SizeCheck& check) {
  const std::optional<EmbeddedDepth> depth = find_embedded_depth(photo, name);
  if (!depth) return {};
  const std::string map_name = "the depth map in " + name;
  std::optional<Decoded> decoded = decode_known(depth->file, map_name, check);
  if (!decoded) unknown_format(map_name);
  decoded->exif.orientation = orientation;
  return disparity_of(*depth, to_map(std::move(*decoded), map_name), name);
}

/// A photo of a format that is read from its bytes, nothing for other formats.
std::optional<Photo> known_photo(std::span<const std::uint8_t> bytes, const std::string& name,
                                 const SizeCheck& check, EmbeddedMap map) {
  std::optional<Decoded> decoded = decode_known(bytes, name, check);
  if (!decoded) return std::nullopt;
  const int orientation = decoded->exif.orientation;
  Photo photo = to_photo(std::move(*decoded), name);
  photo.has_depth = has_embedded_depth(bytes);
  if (map == EmbeddedMap::kRead) photo.disparity = embedded_disparity(bytes, orientation, name, check);
  return photo;
}

/// decode_known(), and PFM.
std::optional<Decoded> decode_known_map(std::span<const std::uint8_t> bytes, const std::string& name,
                                        const SizeCheck& check = {}) {
  if (is_pfm(bytes)) return Decoded{decode_pfm(bytes, name, check), {}, {}};
  return decode_known(bytes, name, check);
}

std::vector<std::uint8_t> read_whole(const std::string& path) {
  std::vector<std::uint8_t> bytes = read_file(path);
  if (bytes.empty()) throw Error(ErrorKind::kBadInput, path + " is an empty file");
  return bytes;
}

Decoded read_any_map(const std::string& path, const SizeCheck& check) {
  std::vector<std::uint8_t> bytes = read_whole(path);
  if (is_npy(bytes)) return {map_from_array(ops::read_npy(path), path, check), {}, {}};
  std::optional<Decoded> decoded = decode_known_map(bytes, path, check);
  bytes = {};  // OpenImageIO reads the file itself
  return decoded ? std::move(*decoded) : read_through_openimageio(path, false, check);
}

}  // namespace

void check_image_size(std::int64_t width, std::int64_t height, const std::string& name) {
  if (width < 1 || height < 1) throw Error(ErrorKind::kBadInput, name + " has no pixels");
  if (width > kMaxImageSide || height > kMaxImageSide || width * height > kMaxImagePixels) {
    throw Error(ErrorKind::kBadInput,
                name + " is " + std::to_string(width) + " x " + std::to_string(height) + " pixels; at most " +
                    std::to_string(kMaxImageSide) + " a side and " + std::to_string(kMaxImagePixels) +
                    " in all are read",
                "make it smaller first");
  }
}

void require_finite(const Image& map, const std::string& name) {
  const auto bad = std::find_if(map.data.begin(), map.data.end(), [](float v) { return !std::isfinite(v); });
  if (bad == map.data.end()) return;
  const auto i = bad - map.data.begin();
  throw Error(ErrorKind::kBadInput,
              name + ": the value at pixel (" + std::to_string(i % map.width) + ", " +
                  std::to_string(i / map.width) + ") is " +
                  (std::isnan(*bad) ? "not a number (NaN)" : "infinite"),
              "replace such pixels by a value, for example that of the farthest point");
}

std::vector<std::uint8_t> read_file(const std::string& path) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  if (file.get() < 0) unreadable(path, errno);
  return read_all(file.get(), path);
}

std::vector<std::uint8_t> read_standard_input() {
  std::vector<std::uint8_t> bytes = read_all(STDIN_FILENO, "standard input");
  if (bytes.empty()) throw Error(ErrorKind::kBadInput, "standard input is empty");
  return bytes;
}

Image oriented(Image image, int orientation) {
  if (orientation < 2 || orientation > 8) return image;
  const bool turned = orientation >= 5;
  const int w = image.width;
  const int h = image.height;
  Image out(turned ? h : w, turned ? w : h, image.channels);
  // Where pixel (x, y) of the shown image lies in the stored one.
  const bool mirror_x = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
  const bool mirror_y = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
  for (int y = 0; y < out.height; ++y) {
    for (int x = 0; x < out.width; ++x) {
      const int u = turned ? y : x;
      const int v = turned ? x : y;
      const float* from =
          image.row(mirror_y ? h - 1 - v : v) +
          static_cast<std::size_t>(mirror_x ? w - 1 - u : u) * static_cast<std::size_t>(image.channels);
      std::copy(from, from + image.channels,
                out.row(y) + static_cast<std::size_t>(x) * static_cast<std::size_t>(image.channels));
    }
  }
  return out;
}

Photo decode_photo(std::span<const std::uint8_t> bytes, const std::string& name, const SizeCheck& check,
                   EmbeddedMap map) {
  return guarded(name, [&] {
    std::optional<Photo> photo = known_photo(bytes, name, check, map);
    if (!photo) unknown_format(name);
    return std::move(*photo);
  });
}

Image decode_map(std::span<const std::uint8_t> bytes, const std::string& name) {
  return guarded(name, [&] {
    std::optional<Decoded> decoded = decode_known_map(bytes, name);
    if (!decoded) unknown_format(name);
    return to_map(std::move(*decoded), name);
  });
}

Photo read_photo(const std::string& path, const SizeCheck& check, EmbeddedMap map) {
  return guarded(path, [&] {
    std::optional<Photo> photo = known_photo(read_whole(path), path, check, map);
    return photo ? std::move(*photo) : to_photo(read_through_openimageio(path, true, check), path);
  });
}

Image read_map(const std::string& path, NonFinite values, const SizeCheck& check) {
  return guarded(path, [&] { return to_map(read_any_map(path, check), path, values); });
}

Image read_matte(const std::string& path, const SizeCheck& check) {
  return guarded(path, [&] {
    Decoded decoded = read_any_map(path, check);
    Image alpha = alpha_of(decoded);
    if (alpha.empty()) return to_map(std::move(decoded), path);
    require_finite(alpha, path);
    return alpha;
  });
}

}  // namespace slide
