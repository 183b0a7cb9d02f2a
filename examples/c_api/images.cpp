// Pixels of a caller and the library's images.

#include <cmath>
#include <cstdint>

#include "examples/c_api/internal.h"
#include "render/image_file.h"

namespace slide::c_api {
namespace {

std::size_t bytes_of(int type) {
  if (type == SLIDE_UINT8) return 1;
  if (type == SLIDE_FLOAT32) return sizeof(float);
  throw Error(ErrorKind::kUsage, "there is no type " + std::to_string(type) + " of pixels",
              "SLIDE_UINT8 or SLIDE_FLOAT32");
}

/// From one row to the next. @throws Error(kUsage) if rows would overlap, or floats would not be aligned
std::size_t row_bytes(std::size_t given, int width, int channels, int type) {
  const std::size_t needed =
      static_cast<std::size_t>(width) * static_cast<std::size_t>(channels) * bytes_of(type);
  if (given == 0) return needed;
  if (given < needed)
    throw Error(ErrorKind::kUsage,
                "row_bytes is " + std::to_string(given) + ", a row has " + std::to_string(needed) + " bytes");
  if (given % bytes_of(type) != 0)
    throw Error(ErrorKind::kUsage,
                "row_bytes is " + std::to_string(given) + ", no multiple of a float's size");
  return given;
}

float value_at(const std::byte* at, int type) {
  if (type == SLIDE_UINT8) return static_cast<float>(std::to_integer<int>(*at)) / 255;
  float value = 0;
  std::memcpy(&value, at, sizeof value);
  return value;
}

/// The first `channels` of each pixel; grey is repeated.
Image read(const slide_image& from, int channels, const std::string& name) {
  require(from.data != nullptr, "the data of an image is NULL");
  check_image_size(from.width, from.height, name);
  const std::size_t row = row_bytes(from.row_bytes, from.width, from.channels, from.type);
  const std::size_t size = bytes_of(from.type);
  Image image(from.width, from.height, channels);
  float* out = image.data.data();
  for (int y = 0; y < from.height; ++y) {
    const std::byte* pixel = static_cast<const std::byte*>(from.data) + static_cast<std::size_t>(y) * row;
    for (int x = 0; x < from.width; ++x, pixel += static_cast<std::size_t>(from.channels) * size)
      for (int c = 0; c < channels; ++c)
        *out++ = value_at(pixel + static_cast<std::size_t>(std::min(c, from.channels - 1)) * size, from.type);
  }
  require_finite(image, name);
  return image;
}

std::uint8_t to_byte(float v) {
  return static_cast<std::uint8_t>(std::lround(255 * std::clamp(std::isnan(v) ? 0.0F : v, 0.0F, 1.0F)));
}

}  // namespace

Image read_colours(const slide_image* image) {
  require(image != nullptr, "the image is NULL");
  require(image->channels == 1 || image->channels == 3 || image->channels == 4,
          "an image of colours has 1, 3 or 4 channels");
  return read(*image, 3, "the image");
}

Image read_map(const slide_image& image, const std::string& name) {
  require(image.channels == 1, "a map has 1 channel");
  return read(image, 1, name);
}

void check_buffer(const slide_buffer* buffer, int width, int height, int channels) {
  require(buffer != nullptr && buffer->data != nullptr, "the buffer or its data is NULL");
  if (buffer->width != width || buffer->height != height || buffer->channels != channels)
    throw Error(ErrorKind::kUsage,
                "the buffer has " + std::to_string(buffer->width) + "x" + std::to_string(buffer->height) +
                    "x" + std::to_string(buffer->channels) + " values, needed are " + std::to_string(width) +
                    "x" + std::to_string(height) + "x" + std::to_string(channels));
  (void)row_bytes(buffer->row_bytes, buffer->width, buffer->channels, buffer->type);
}

void write_buffer(const Image& image, const slide_buffer& buffer) {
  check_buffer(&buffer, image.width, image.height, image.channels);
  const std::size_t row = row_bytes(buffer.row_bytes, buffer.width, buffer.channels, buffer.type);
  const std::size_t values = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.channels);
  for (int y = 0; y < image.height; ++y) {
    auto* out = static_cast<std::byte*>(buffer.data) + static_cast<std::size_t>(y) * row;
    const float* in = image.row(y);
    if (buffer.type == SLIDE_FLOAT32)
      std::memcpy(out, in, values * sizeof(float));
    else
      std::transform(in, in + values, reinterpret_cast<std::uint8_t*>(out), to_byte);
  }
}

}  // namespace slide::c_api
