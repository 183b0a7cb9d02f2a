#include "runtime/safetensors.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <system_error>
#include <utility>

#include "runtime/calibration.h"
#include "runtime/crc32c.h"
#include "runtime/error.h"
#include "runtime/foreign_format.h"
#include "runtime/safetensors_header.h"
#include "runtime/threads.h"

namespace slide {
namespace {

static_assert(std::endian::native == std::endian::little, "the format is little-endian and is not converted");

constexpr std::uint64_t kLengthBytes = 8;
constexpr std::string_view kChecksum = "crc32c";
constexpr std::string_view kChecksumPrefix = "crc32c.";

Error bad(const std::string& problem, const std::string& remedy = "") {
  return Error(ErrorKind::kBadWeights, problem, remedy);
}

/// A file mapped for reading, from its first byte to its last.
class Mapping {
 public:
  explicit Mapping(const std::string& path) {
    const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (descriptor < 0) fail(path, errno);
    struct stat status {};
    const int code = ::fstat(descriptor, &status) != 0 ? errno : 0;
    if (code == 0 && S_ISREG(status.st_mode) && status.st_size > 0) {
      size_ = static_cast<std::size_t>(status.st_size);
      start_ = ::mmap(nullptr, size_, PROT_READ, MAP_PRIVATE, descriptor, 0);
    }
    const int map_code = errno;
    ::close(descriptor);
    if (code != 0) fail(path, code);
    if (!S_ISREG(status.st_mode)) throw bad("cannot read " + path + ": it is not a regular file");
    if (start_ == MAP_FAILED) fail(path, map_code);
  }
  ~Mapping() {
    if (start_ != MAP_FAILED && start_ != nullptr) ::munmap(start_, size_);
  }
  Mapping(const Mapping&) = delete;
  Mapping& operator=(const Mapping&) = delete;
  [[nodiscard]] std::span<const std::byte> bytes() const noexcept {
    return {static_cast<const std::byte*>(start_), size_};
  }

 private:
  [[noreturn]] static void fail(const std::string& path, int code) {
    throw bad("cannot read " + path + ": " + std::generic_category().message(code));
  }
  void* start_ = nullptr;
  std::size_t size_ = 0;
};

/// The length of the header, and the header itself in memory of its own: what was checked cannot change any
/// more.
std::string copy_of_header(std::span<const std::byte> bytes, const std::string& file) {
  constexpr std::size_t kStart = 512;
  if (const auto other = foreign_format(bytes.first(std::min(bytes.size(), kStart))))
    throw bad(file + ": this is " + std::string(other->name), std::string(other->remedy));
  const std::string size = std::to_string(bytes.size());
  if (bytes.size() < kLengthBytes)
    throw bad(file + ": the file is cut short: " + size +
              " bytes cannot hold the length of a header (byte 0)");
  std::uint64_t length;
  std::memcpy(&length, bytes.data(), sizeof length);
  if (length > kMaxSafetensorsHeader)
    throw bad(file + ": the header would have " + std::to_string(length) + " bytes, more than the format's " +
                  std::to_string(kMaxSafetensorsHeader) + " (byte 0)",
              "is it a safetensors file?");
  if (length > bytes.size() - kLengthBytes)
    throw bad(file + ": the file is cut short: the header has " + std::to_string(length) +
              " bytes, but the file ends at byte " + size);
  std::string text(static_cast<std::size_t>(length), '\0');
  std::memcpy(text.data(), bytes.data() + kLengthBytes, text.size());
  return text;
}

std::size_t alignment_of(DType type) noexcept { return size_of(type); }

/// The index of the first NaN or infinity, or `count`. Looks at a block as a whole first, which vectorises.
template <typename Bits>
std::size_t first_with_full_exponent(std::span<const std::byte> bytes, Bits exponent_mask) {
  constexpr std::size_t kBlock = 4096;
  const std::size_t count = bytes.size() / sizeof(Bits);
  const auto is_full = [&](std::size_t i) {
    Bits value;
    std::memcpy(&value, bytes.data() + i * sizeof(Bits), sizeof value);
    return (value & exponent_mask) == exponent_mask;
  };
  for (std::size_t begin = 0; begin < count; begin += kBlock) {
    const std::size_t end = std::min(count, begin + kBlock);
    Bits any = 0;
    for (std::size_t i = begin; i < end; ++i) any |= static_cast<Bits>(is_full(i));
    if (any == 0) continue;
    for (std::size_t i = begin; i < end; ++i)
      if (is_full(i)) return i;
  }
  return count;
}

}  // namespace

std::optional<std::size_t> first_not_finite(DType type, std::span<const std::byte> elements) {
  std::size_t i = 0;
  switch (type) {
    case DType::kF64:
      i = first_with_full_exponent<std::uint64_t>(elements, 0x7FF0'0000'0000'0000u);
      break;
    case DType::kF32:
      i = first_with_full_exponent<std::uint32_t>(elements, 0x7F80'0000u);
      break;
    case DType::kF16:
      i = first_with_full_exponent<std::uint16_t>(elements, 0x7C00u);
      break;
    case DType::kBF16:
      i = first_with_full_exponent<std::uint16_t>(elements, 0x7F80u);
      break;
    default:
      return std::nullopt;
  }
  if (i * size_of(type) == elements.size()) return std::nullopt;
  return i;
}

SafetensorsFile SafetensorsFile::open(const std::string& path) {
  const auto mapping = std::make_shared<const Mapping>(path);
  SafetensorsFile file = from_memory(mapping->bytes(), path, mapping);
  file.mapped_ = true;
  return file;
}

SafetensorsFile SafetensorsFile::from_memory(std::span<const std::byte> bytes, std::string description,
                                             std::shared_ptr<const void> owner) {
  const std::string text = copy_of_header(bytes, description);
  SafetensorsFile file;
  file.description_ = std::move(description);
  file.owner_ = std::move(owner);
  file.data_start_ = kLengthBytes + text.size();
  file.data_ = bytes.subspan(static_cast<std::size_t>(file.data_start_));
  SafetensorsHeader header = parse_safetensors_header(text, file.data_.size(), file.description_);
  file.metadata_ = std::move(header.metadata);
  for (SafetensorsHeader::Entry& entry : header.entries) {
    file.index_.emplace(entry.info.name, file.tensors_.size());
    file.begins_.push_back(entry.begin);
    file.tensors_.push_back(std::move(entry.info));
  }
  file.check_checksum_keys();
  return file;
}

void SafetensorsFile::check_checksum_keys() const {
  constexpr const char* kRemedy =
      "the file is damaged, or another program changed it and kept the old checksums";
  if (const auto list = metadata_.find(kChecksum); list != metadata_.end())
    if (list->second != checksum_text(checksum_of_list(tensors_)))
      throw bad(
          description_ + ": the names, dtypes and shapes of the tensors do not match their checksum (byte 8)",
          kRemedy);
  bool any = false;
  for (auto it = metadata_.lower_bound(kChecksumPrefix);
       it != metadata_.end() && it->first.starts_with(kChecksumPrefix); ++it) {
    any = true;
    if (!contains(std::string_view(it->first).substr(kChecksumPrefix.size())))
      throw bad(
          description_ + ": the metadata has \"" + it->first + "\", but there is no such tensor (byte 8)",
          kRemedy);
  }
  if (!any) return;
  for (const TensorInfo& info : tensors_)
    if (!metadata_.contains(std::string(kChecksumPrefix) + info.name))
      throw bad(
          description_ + ": tensor " + info.name + " has no checksum in the metadata, others have (byte 8)",
          kRemedy);
}

std::vector<std::string> SafetensorsFile::names() const {
  std::vector<std::string> names;
  names.reserve(tensors_.size());
  for (const TensorInfo& info : tensors_) names.push_back(info.name);
  return names;
}

std::size_t SafetensorsFile::find(std::string_view name) const {
  const auto it = index_.find(name);
  if (it == index_.end()) throw bad(description_ + ": there is no tensor " + std::string(name));
  return it->second;
}

std::span<const std::byte> SafetensorsFile::raw(std::size_t i) const {
  return data_.subspan(static_cast<std::size_t>(begins_[i]), tensors_[i].bytes());
}

const TensorInfo& SafetensorsFile::info(std::string_view name) const { return tensors_[find(name)]; }

Tensor SafetensorsFile::tensor(std::string_view name) const {
  const std::size_t i = find(name);
  const TensorInfo& info = tensors_[i];
  const std::span<const std::byte> bytes = raw(i);
  if (reinterpret_cast<std::uintptr_t>(bytes.data()) % alignment_of(info.dtype) == 0)
    return Tensor::read_only(info.dtype, info.shape, bytes.data(), owner_);
  Tensor copy(info.dtype, info.shape);
  std::ranges::copy(bytes, copy.mutable_raw().begin());
  return copy;
}

void SafetensorsFile::release(std::string_view name) const { release(raw(find(name))); }

void SafetensorsFile::release() const { release(data_); }

void SafetensorsFile::release(std::span<const std::byte> bytes) const {
  if (!mapped_ || bytes.empty()) return;
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  const std::size_t before = reinterpret_cast<std::uintptr_t>(bytes.data()) % page;
  (void)::madvise(const_cast<std::byte*>(bytes.data()) - before, before + bytes.size(), MADV_DONTNEED);
}

bool SafetensorsFile::has_checksums() const noexcept {
  return !tensors_.empty() && metadata_.contains(std::string(kChecksumPrefix) + tensors_.front().name);
}

void SafetensorsFile::require_checksum(std::size_t i, std::uint32_t crc) const {
  const std::string& wanted = metadata_.find(std::string(kChecksumPrefix) + tensors_[i].name)->second;
  if (checksum_text(crc) != wanted)
    throw bad(description_ + ": tensor " + tensors_[i].name +
                  ": its data does not match its checksum (bytes " +
                  std::to_string(data_start_ + begins_[i]) + " to " +
                  std::to_string(data_start_ + begins_[i] + tensors_[i].bytes()) + ")",
              "the file is damaged; fetch or convert it again");
}

void SafetensorsFile::require_finite(std::size_t i, std::optional<std::size_t> found) const {
  if (found)
    throw bad(description_ + ": tensor " + tensors_[i].name + ": element " + std::to_string(*found) +
                  " is not a finite number (byte " +
                  std::to_string(data_start_ + begins_[i] + *found * size_of(tensors_[i].dtype)) + ")",
              "the network was saved after its training had diverged, or the file is damaged");
}

std::size_t SafetensorsFile::verify_crc() const {
  if (!has_checksums()) return 0;
  std::vector<std::uint32_t> crcs(tensors_.size());
  parallel_for(static_cast<std::int64_t>(crcs.size()), [&](std::int64_t i) {
    crcs[static_cast<std::size_t>(i)] = crc32c(raw(static_cast<std::size_t>(i)));
  });
  for (std::size_t i = 0; i < crcs.size(); ++i) require_checksum(i, crcs[i]);
  return crcs.size();
}

void SafetensorsFile::verify_crc(std::string_view name) const {
  const std::size_t i = find(name);
  if (has_checksums()) require_checksum(i, crc32c(raw(i)));
}

void SafetensorsFile::check_finite() const {
  std::vector<std::optional<std::size_t>> found(tensors_.size());
  parallel_for(static_cast<std::int64_t>(found.size()), [&](std::int64_t index) {
    const auto i = static_cast<std::size_t>(index);
    found[i] = first_not_finite(tensors_[i].dtype, raw(i));
  });
  for (std::size_t i = 0; i < found.size(); ++i) require_finite(i, found[i]);
}

void SafetensorsFile::check_finite(std::string_view name) const {
  const std::size_t i = find(name);
  require_finite(i, first_not_finite(tensors_[i].dtype, raw(i)));
}

SafetensorsWeights::SafetensorsWeights(SafetensorsFile file)
    : file_(std::move(file)), checked_(file_.tensors().size()) {
  for (std::size_t i = 0; i < file_.tensors().size(); ++i) places_.emplace(file_.tensors()[i].name, i);
  if (const auto it = file_.metadata().find(kCalibrationKey); it != file_.metadata().end())
    calibration_ = std::make_shared<const Calibration>(parse_calibration(it->second, file_.description()));
}

std::optional<Tensor> SafetensorsWeights::find(std::string_view name, const Shape& /*wanted*/) const {
  if (!file_.contains(name)) return std::nullopt;
  return file_.tensor(name);
}

void SafetensorsWeights::check(std::string_view name, const Tensor& /*tensor*/) const {
  const auto place = places_.find(name);
  if (place == places_.end() || checked_[place->second].load(std::memory_order_relaxed)) return;
  file_.verify_crc(name);
  file_.check_finite(name);
  checked_[place->second].store(true, std::memory_order_relaxed);
}

}  // namespace slide
