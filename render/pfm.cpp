#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "render/codec.h"
#include "render/image_file.h"
#include "runtime/error.h"

namespace slide {
namespace {

bool is_space(std::uint8_t c) { return c == ' ' || c == '\n' || c == '\r' || c == '\t'; }

[[noreturn]] void malformed(const std::string& name, const std::string& what) {
  throw Error(ErrorKind::kBadInput, name + " is a malformed PFM file: " + what);
}

/// Takes one word of the header and the one white space character that ends it.
std::string take_word(std::span<const std::uint8_t>& bytes, const std::string& name) {
  constexpr std::size_t kLongestWord = 40;
  const auto end = std::find_if(bytes.begin(), bytes.end(), is_space);
  const auto length = static_cast<std::size_t>(end - bytes.begin());
  if (end == bytes.end() || length == 0 || length > kLongestWord) malformed(name, "its header is broken");
  std::string word(bytes.begin(), end);
  bytes = bytes.subspan(length + 1);
  return word;
}

std::int64_t take_count(std::span<const std::uint8_t>& bytes, const std::string& name) {
  const std::string word = take_word(bytes, name);
  if (word.size() > 9 ||
      !std::all_of(word.begin(), word.end(), [](char c) { return c >= '0' && c <= '9'; })) {
    malformed(name, "\"" + word + "\" is no size");
  }
  return std::strtol(word.c_str(), nullptr, 10);
}

std::uint32_t swapped(std::uint32_t v) {
  return v >> 24U | (v >> 8U & 0xFF00U) | (v << 8U & 0xFF0000U) | v << 24U;
}

}  // namespace

bool is_pfm(std::span<const std::uint8_t> bytes) noexcept {
  return bytes.size() >= 3 && bytes[0] == 'P' && (bytes[1] == 'f' || bytes[1] == 'F') && is_space(bytes[2]);
}

Image decode_pfm(std::span<const std::uint8_t> bytes, const std::string& name, const SizeCheck& check) {
  if (!is_pfm(bytes)) malformed(name, "it does not begin with Pf or PF");
  const int channels = take_word(bytes, name) == "PF" ? 3 : 1;
  const std::int64_t width = take_count(bytes, name);
  const std::int64_t height = take_count(bytes, name);
  const std::string scale_word = take_word(bytes, name);
  const double scale = std::strtod(scale_word.c_str(), nullptr);
  if (!std::isfinite(scale) || scale == 0) malformed(name, "its scale is \"" + scale_word + "\"");
  check_image_size(width, height, name);
  if (check) check(static_cast<int>(width), static_cast<int>(height));
  const auto row_bytes = static_cast<std::size_t>(width) * static_cast<std::size_t>(channels) * sizeof(float);
  if (bytes.size() < row_bytes * static_cast<std::size_t>(height)) {
    malformed(name, "it holds " + std::to_string(bytes.size()) + " bytes of values where its size needs " +
                        std::to_string(row_bytes * static_cast<std::size_t>(height)));
  }
  Image image(static_cast<int>(width), static_cast<int>(height), channels);
  for (int y = 0; y < image.height; ++y) {
    std::memcpy(image.row(image.height - 1 - y), bytes.data() + static_cast<std::size_t>(y) * row_bytes,
                row_bytes);
  }
  const bool file_is_little = scale < 0;
  if (file_is_little != (std::endian::native == std::endian::little)) {
    for (float& v : image.data) v = std::bit_cast<float>(swapped(std::bit_cast<std::uint32_t>(v)));
  }
  return image;
}

std::vector<std::uint8_t> encode_pfm(const Image& image) {
  static_assert(std::endian::native == std::endian::little, "the header says little-endian");
  if (image.empty() || (image.channels != 1 && image.channels != 3)) {
    throw Error(ErrorKind::kInternal, "encode_pfm: an image of 1 or 3 channels is needed");
  }
  const std::string header = std::string(image.channels == 3 ? "PF\n" : "Pf\n") +
                             std::to_string(image.width) + " " + std::to_string(image.height) + "\n-1.0\n";
  const std::size_t row_values =
      static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.channels);
  std::vector<std::uint8_t> bytes(header.size() + image.data.size() * sizeof(float));
  std::copy(header.begin(), header.end(), bytes.begin());
  std::uint8_t* out = bytes.data() + header.size();
  for (int y = image.height - 1; y >= 0; --y) {
    std::memcpy(out, image.row(y), row_values * sizeof(float));
    out += row_values * sizeof(float);
  }
  return bytes;
}

}  // namespace slide
