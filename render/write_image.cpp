#include "render/write_image.h"

#include <algorithm>
#include <filesystem>

#include "render/codec.h"
#include "render/oiio.h"
#include "runtime/atomic_file.h"
#include "runtime/error.h"

namespace slide {

void write_bytes(const std::string& path, std::span<const std::uint8_t> bytes) {
  AtomicFile file(path);
  file.write(std::as_bytes(bytes));
  file.commit();
}

void write_png(const std::string& path, const Image& image, int bits) {
  write_bytes(path, encode_png(image, bits));
}

void write_jpeg(const std::string& path, const Image& image, int quality) {
  write_bytes(path, encode_jpeg(image, quality));
}

void write_pfm(const std::string& path, const Image& image) { write_bytes(path, encode_pfm(image)); }

void write_exr(const std::string& path, const Image& image) {
  AtomicFile file(path);
  write_exr_unsafely(file.temporary_path(), image);
  file.commit();
}

void write_image(const std::string& path, const Image& image) {
  const std::string extension = lower_extension(path);
  if (extension == ".png") return write_png(path, image);
  if (extension == ".jpg" || extension == ".jpeg") return write_jpeg(path, image);
  if (extension == ".pfm") return write_pfm(path, image);
  if (extension == ".exr") return write_exr(path, image);
  throw Error(ErrorKind::kUsage, "cannot tell from its name what kind of image " + path + " is to be",
              "end it in .png, .jpg, .pfm or .exr");
}

std::string lower_extension(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; });
  return extension;
}

}  // namespace slide
