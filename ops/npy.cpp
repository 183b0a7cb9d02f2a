#include "ops/npy.h"

#include <array>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <vector>

#include "runtime/error.h"

namespace slide::ops {
namespace {

constexpr std::string_view kMagic = "\x93NUMPY";
constexpr std::size_t kMaxHeader = 1 << 16;

Error bad(const std::string& path, const std::string& problem, const std::string& remedy = "") {
  return Error(ErrorKind::kBadInput, path + ": " + problem, remedy);
}

/// The text behind 'key': in the header's Python dictionary.
std::string_view value_of(std::string_view header, std::string_view key, const std::string& path) {
  const std::string quoted = "'" + std::string(key) + "':";
  const std::size_t at = header.find(quoted);
  if (at == std::string_view::npos) throw bad(path, "the header has no entry " + std::string(key));
  header.remove_prefix(at + quoted.size());
  while (header.starts_with(' ')) header.remove_prefix(1);
  return header;
}

Shape shape_of(std::string_view text, const std::string& path) {
  const Error error = bad(path, "the header's shape is not one of up to five extents");
  if (!text.starts_with('(')) throw error;
  std::vector<std::int64_t> extents;
  std::int64_t count = 1;
  for (const char* p = text.data() + 1;;) {
    const char* const end = text.data() + text.size();
    while (p != end && (*p == ' ' || *p == ',')) ++p;
    if (p == end) throw error;
    if (*p == ')') break;
    std::int64_t extent = 0;
    const auto [next, code] = std::from_chars(p, end, extent);
    if (code != std::errc() || extent < 0 || extents.size() == Shape::kMaxRank ||
        __builtin_mul_overflow(count, std::max<std::int64_t>(extent, 1), &count) || count >> 40 != 0)
      throw error;
    extents.push_back(extent);
    p = next;
  }
  return Shape(std::span<const std::int64_t>(extents));
}

DType type_of(std::string_view text, const std::string& path) {
  if (text.starts_with("'<f4'")) return DType::kF32;
  if (text.starts_with("'<f8'")) return DType::kF64;
  if (text.starts_with("'<f2'")) return DType::kF16;
  throw bad(path, "the array is not of float16, float32 or float64, little-endian", "save y.astype('<f4')");
}

}  // namespace

Tensor read_npy(const std::string& path) {
  std::error_code code;
  const std::uintmax_t size = std::filesystem::file_size(path, code);
  std::ifstream file(path, std::ios::binary);
  if (code || !file) throw bad(path, "cannot read the file" + (code ? ": " + code.message() : ""));
  std::array<char, 8> start{};
  file.read(start.data(), start.size());
  if (!file || std::string_view(start.data(), kMagic.size()) != kMagic)
    throw bad(path, "this is no .npy file");
  const int version = static_cast<unsigned char>(start[6]);
  if (version < 1 || version > 3)
    throw bad(path, "version " + std::to_string(version) + " of .npy is not read");
  std::uint32_t length = 0;
  file.read(reinterpret_cast<char*>(&length), version == 1 ? 2 : 4);
  if (!file || length > kMaxHeader) throw bad(path, "the header is cut short or too long (byte 8)");
  std::string header(length, '\0');
  file.read(header.data(), static_cast<std::streamsize>(length));
  if (!file) throw bad(path, "the file ends within its header");
  const DType type = type_of(value_of(header, "descr", path), path);
  const Shape shape = shape_of(value_of(header, "shape", path), path);
  if (!value_of(header, "fortran_order", path).starts_with("False") && shape.rank() > 1)
    throw bad(path, "the array is in Fortran order", "save numpy.ascontiguousarray(y)");
  const std::uintmax_t begin = 8 + (version == 1 ? 2 : 4) + length;
  const std::uintmax_t bytes = static_cast<std::uintmax_t>(shape.count()) * size_of(type);
  if (size - begin != bytes)
    throw bad(path, "the data has " + std::to_string(size - begin) + " bytes, " + shape.text() +
                        " elements of " + std::string(name_of(type)) + " are " + std::to_string(bytes));
  Tensor tensor(type, shape);
  const std::span<std::byte> raw = tensor.mutable_raw();
  file.read(reinterpret_cast<char*>(raw.data()), static_cast<std::streamsize>(raw.size()));
  if (!file) throw bad(path, "the file was cut short while it was read");
  return tensor;
}

}  // namespace slide::ops
