#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "weights_tools/file_reader.h"

namespace slide {

/// The members of a zip archive (PKWARE APPNOTE 6.3, zip64 included), read from its central directory.
/// Members may be stored or deflated. Everything else (encryption, several disks, other methods, a member
/// outside of the file, a name that comes twice) is Error(kBadWeights) naming the file, the member and the
/// byte offset.
class ZipArchive {
 public:
  struct Member {
    std::string name;
    std::uint64_t size = 0;             ///< of the contents
    std::uint64_t compressed_size = 0;  ///< in the file
    std::uint64_t header_offset = 0;    ///< of the local header, in the file
    std::uint32_t crc = 0;              ///< CRC-32 of the contents
    bool deflated = false;
  };

  /// Reads the directory. `file` must outlive the archive.
  explicit ZipArchive(const FileReader& file);

  /// All members, in the directory's order.
  [[nodiscard]] const std::vector<Member>& members() const noexcept { return members_; }
  /// The member of that name, or null.
  [[nodiscard]] const Member* find(std::string_view name) const;
  /// Fills `out`, which must have the member's size, with its contents, and checks their CRC-32.
  void read(const Member& member, std::span<std::byte> out) const;

 private:
  [[nodiscard]] std::uint64_t data_offset(const Member& member) const;

  const FileReader& file_;
  std::vector<Member> members_;
  std::map<std::string, std::size_t, std::less<>> index_;
};

}  // namespace slide
