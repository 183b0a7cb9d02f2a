#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace slide {

/// A regular file that is read piece by piece at any offset. Reading into buffers rather than mapping keeps
/// the process small whatever the file's size, and a file that is cut short meanwhile is an error, not a
/// signal. Failures are Error(kBadWeights) naming the file and the system's reason.
class FileReader {
 public:
  explicit FileReader(const std::string& path);
  ~FileReader();
  FileReader(const FileReader&) = delete;
  FileReader& operator=(const FileReader&) = delete;

  [[nodiscard]] const std::string& path() const noexcept { return path_; }
  [[nodiscard]] std::uint64_t size() const noexcept { return size_; }
  /// Fills `out` from the file. Throws if the file ends before.
  void read(std::uint64_t offset, std::span<std::byte> out) const;
  [[nodiscard]] std::vector<std::byte> read(std::uint64_t offset, std::size_t count) const;
  /// Hands out [offset, offset + count) in pieces of at most 256 KB.
  void for_each_piece(std::uint64_t offset, std::uint64_t count,
                      const std::function<void(std::span<const std::byte>)>& take) const;

 private:
  void require(std::uint64_t offset, std::uint64_t count) const;

  std::string path_;
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
};

/// The SHA-256 of a whole file, 64 hexadecimal digits.
[[nodiscard]] std::string sha256_of(const FileReader& file);

}  // namespace slide
