#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "runtime/tensor.h"
#include "runtime/weights.h"

namespace slide {

/// Name, element type and shape of a tensor in a file.
struct TensorInfo {
  std::string name;
  DType dtype;
  Shape shape;
  [[nodiscard]] std::size_t bytes() const noexcept {
    return static_cast<std::size_t>(shape.count()) * size_of(dtype);
  }
};

/// Metadata of a safetensors file: any strings, by key.
///
/// Our writer adds checksums: "crc32c.NAME" is the CRC-32C of the bytes of tensor NAME, and "crc32c" that of
/// the list of tensors: sorted by name, for each the name, a zero byte, the dtype, a zero byte, the extents
/// joined by "x", a line feed. All are eight lower-case hexadecimal digits.
using Metadata = std::map<std::string, std::string, std::less<>>;

/// The index of the first NaN or infinity among elements of a type, which may lie misaligned; nothing if all
/// are finite, as integers always are.
[[nodiscard]] std::optional<std::size_t> first_not_finite(DType type, std::span<const std::byte> elements);

/// A safetensors file (https://github.com/huggingface/safetensors: eight bytes little-endian header length,
/// JSON header, data), memory-mapped: tensors are views of the file, read from the disk when they are
/// touched.
///
/// The file is hostile until checked. Opening it throws Error(kBadWeights) naming the file, the tensor and
/// the byte offset if the file is shorter than it says, the header is over 100 MB, is not UTF-8 or not the
/// JSON that the format asks for, a key comes twice, a name holds control characters, a dtype is unknown, a
/// rank is over 5, a product of extents overflows, offsets do not match the size, overlap or leave gaps,
/// bytes are left at the end, or the checksums in the metadata do not belong to the tensors listed. The
/// header is read once and never looked at again, so a file that changes later can change values but nothing
/// that was checked. (A file that is cut short while it is mapped ends the process with SIGBUS, as for any
/// program that maps files.)
class SafetensorsFile {
 public:
  /// Maps a file. Throws Error(kBadWeights) if it cannot be opened or is not a regular file, too.
  static SafetensorsFile open(const std::string& path);
  /// A file that lies in memory, kept alive by `owner` (null: it lives on, as data compiled into the program
  /// does).
  static SafetensorsFile from_memory(std::span<const std::byte> bytes, std::string description,
                                     std::shared_ptr<const void> owner = nullptr);

  /// What messages call it: the path.
  [[nodiscard]] const std::string& description() const noexcept { return description_; }
  [[nodiscard]] const Metadata& metadata() const noexcept { return metadata_; }
  /// All tensors, in the order of the header.
  [[nodiscard]] const std::vector<TensorInfo>& tensors() const noexcept { return tensors_; }
  [[nodiscard]] std::vector<std::string> names() const;
  [[nodiscard]] bool contains(std::string_view name) const { return index_.contains(name); }
  /// The entry of a tensor. Throws Error(kBadWeights) if there is none of that name.
  [[nodiscard]] const TensorInfo& info(std::string_view name) const;

  /// A read-only view that keeps the mapping alive. If the data is not aligned for its element type, which
  /// other writers' files may be, a copy. Throws Error(kBadWeights) if there is no tensor of that name.
  [[nodiscard]] Tensor tensor(std::string_view name) const;

  /// Gives the memory of a tensor's data back to the system, if the file was mapped by open(): the pages that
  /// hold any of it are read again when they are next touched. Throws Error(kBadWeights) if there is no
  /// tensor of that name.
  void release(std::string_view name) const;
  /// The same for all tensors.
  void release() const;

  /// True if the metadata holds a checksum for every tensor.
  [[nodiscard]] bool has_checksums() const noexcept;
  /// Reads all data and compares the checksums, if the file has them; throws Error(kBadWeights) naming the
  /// first tensor whose data does not match and its byte offset. Returns the number of tensors compared.
  std::size_t verify_crc() const;
  /// The same for one tensor.
  void verify_crc(std::string_view name) const;
  /// Reads all floating-point tensors; throws Error(kBadWeights) naming the first tensor that holds a NaN or
  /// an infinity, and the byte offset of the first such element.
  void check_finite() const;
  /// The same for one tensor.
  void check_finite(std::string_view name) const;

 private:
  SafetensorsFile() = default;
  [[nodiscard]] std::size_t find(std::string_view name) const;
  [[nodiscard]] std::span<const std::byte> raw(std::size_t i) const;
  void release(std::span<const std::byte> bytes) const;
  void check_checksum_keys() const;
  void require_checksum(std::size_t i, std::uint32_t crc) const;
  void require_finite(std::size_t i, std::optional<std::size_t> found) const;

  std::string description_;
  std::span<const std::byte> data_;
  std::uint64_t data_start_ = 0;  // in the file
  std::shared_ptr<const void> owner_;
  bool mapped_ = false;
  Metadata metadata_;
  std::vector<TensorInfo> tensors_;
  std::vector<std::uint64_t> begins_;  // within the data, one for each tensor
  std::map<std::string, std::size_t, std::less<>> index_;
};

/// The tensors of a safetensors file as a graph's weights. A tensor's checksum and values are checked when it
/// is first used, not again for the executors that follow.
class SafetensorsWeights : public WeightSource {
 public:
  /// Throws Error(kBadWeights) if the metadata holds a calibration that is not what parse_calibration()
  /// reads.
  explicit SafetensorsWeights(SafetensorsFile file);
  explicit SafetensorsWeights(const std::string& path) : SafetensorsWeights(SafetensorsFile::open(path)) {}
  [[nodiscard]] const SafetensorsFile& file() const noexcept { return file_; }
  [[nodiscard]] std::string description() const override { return file_.description(); }
  [[nodiscard]] std::optional<Tensor> find(std::string_view name, const Shape& wanted) const override;
  void check(std::string_view name, const Tensor& tensor) const override;
  void release(std::string_view name) const override { file_.release(name); }
  void release() const override { file_.release(); }
  [[nodiscard]] std::vector<std::string> names() const override { return file_.names(); }
  [[nodiscard]] const Calibration* calibration() const override { return calibration_.get(); }

 private:
  SafetensorsFile file_;
  std::map<std::string_view, std::size_t> places_;
  mutable std::vector<std::atomic<bool>> checked_;
  std::shared_ptr<const Calibration> calibration_;
};

}  // namespace slide
