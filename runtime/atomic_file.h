#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace slide {

/// A file that appears under its name only when it is complete. It is written under a temporary name in the
/// same folder; commit() brings it to the disk and renames it, replacing an older file in one step. Without
/// commit() the destructor removes it, and the older file stays as it was.
///
/// All members throw Error(kOutput) naming the file and the system's reason if it cannot be created or
/// written.
///
/// A process that is killed leaves its temporary files, named TARGET.part-PROCESS-NUMBER. The first
/// AtomicFile of a later process in that folder removes those whose process has ended and which nobody holds
/// open.
class AtomicFile {
 public:
  /// Creates the temporary file. A symbolic link is followed. Refuses a path that is a folder, a device or a
  /// pipe.
  explicit AtomicFile(const std::string& path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  /// Appends bytes after the last ones appended.
  void write(std::span<const std::byte> bytes);
  void write(std::string_view text) { write(std::as_bytes(std::span(text))); }
  /// Writes bytes at an offset, without moving the place where write() goes on; a gap reads as zeros.
  void write_at(std::uint64_t offset, std::span<const std::byte> bytes);

  /// Flushes to the disk and renames. Nothing can be written afterwards.
  void commit();

  /// The name it will have.
  [[nodiscard]] const std::string& path() const noexcept { return path_; }
  /// The name it has until then, absolute: for another library or program that fills it instead of write().
  [[nodiscard]] const std::string& temporary_path() const noexcept { return temporary_; }
  /// Bytes appended by write() so far.
  [[nodiscard]] std::uint64_t size() const noexcept { return size_; }

 private:
  void discard() noexcept;

  std::string path_;
  std::string temporary_;
  int descriptor_ = -1;
  int slot_ = -1;
  std::uint64_t size_ = 0;
};

/// Whether two paths lead to the same existing file, whatever their spelling and the links between. For
/// programs that must not replace what they read.
[[nodiscard]] bool same_file(const std::string& a, const std::string& b) noexcept;

/// Removes the temporary files of every AtomicFile that is not committed. Async-signal-safe: meant for a
/// handler of SIGINT or SIGTERM, after which the process ends without running destructors. Knows the first 64
/// files open at once.
void remove_unfinished_files() noexcept;

/// Makes SIGINT, SIGTERM and SIGHUP remove unfinished files before they end the process as they would have. A
/// signal that the process ignores stays ignored.
void remove_unfinished_files_on_signals() noexcept;

}  // namespace slide
