#include "weights_tools/zip.h"

#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <limits>

#include "runtime/error.h"
#include "runtime/safetensors_header.h"

namespace slide {
namespace {

// Signatures and fixed sizes of the records; the numbers in brackets are APPNOTE's section numbers.
constexpr std::uint32_t kLocalHeader = 0x04034b50;      // [4.3.7]
constexpr std::uint32_t kDirectoryHeader = 0x02014b50;  // [4.3.12]
constexpr std::uint32_t kEnd64 = 0x06064b50;            // [4.3.14]
constexpr std::uint32_t kEnd64Locator = 0x07064b50;     // [4.3.15]
constexpr std::uint32_t kEnd = 0x06054b50;              // [4.3.16]
constexpr std::size_t kLocalHeaderSize = 30;
constexpr std::size_t kDirectoryHeaderSize = 46;
constexpr std::size_t kEnd64Size = 56;
constexpr std::size_t kEnd64LocatorSize = 20;
constexpr std::size_t kEndSize = 22;
constexpr std::size_t kMaxComment = 65535;
constexpr std::uint64_t kMaxDirectory = std::uint64_t{64} << 20;
constexpr std::uint16_t kEncrypted = 1;
constexpr std::uint16_t kStored = 0;
constexpr std::uint16_t kDeflated = 8;

template <typename T>
T little(std::span<const std::byte> bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.subspan(at, sizeof value).data(), sizeof value);
  return value;
}

struct Directory {
  std::uint64_t offset = 0;
  std::uint64_t size = 0;
  std::uint64_t entries = 0;
};

Error bad(const FileReader& file, const std::string& problem, std::uint64_t at) {
  return Error(ErrorKind::kBadWeights, file.path() + ": " + problem + " (byte " + std::to_string(at) + ")");
}

/// The end record is the last one of the file, followed only by a comment of at most 65535 bytes.
Directory find_directory(const FileReader& file) {
  const auto tail_size =
      static_cast<std::size_t>(std::min<std::uint64_t>(file.size(), kEndSize + kMaxComment));
  const std::uint64_t tail_start = file.size() - tail_size;
  const std::vector<std::byte> tail = file.read(tail_start, tail_size);
  std::size_t at = tail_size < kEndSize ? 0 : tail_size - kEndSize + 1;
  do {
    if (at == 0)
      throw bad(file, "the zip archive has no end record: the file is cut short or damaged", file.size());
    --at;
  } while (little<std::uint32_t>(tail, at) != kEnd ||
           at + kEndSize + little<std::uint16_t>(tail, at + 20) != tail_size);
  const std::uint64_t end = tail_start + at;
  Directory directory{little<std::uint32_t>(tail, at + 16), little<std::uint32_t>(tail, at + 12),
                      little<std::uint16_t>(tail, at + 10)};
  if (little<std::uint16_t>(tail, at + 4) != little<std::uint16_t>(tail, at + 6))
    throw bad(file, "the zip archive spans several files", end);
  if (end < kEnd64LocatorSize) return directory;
  const std::vector<std::byte> locator = file.read(end - kEnd64LocatorSize, kEnd64LocatorSize);
  if (little<std::uint32_t>(locator, 0) != kEnd64Locator) return directory;
  const auto end64_at = little<std::uint64_t>(locator, 8);
  const std::vector<std::byte> end64 = file.read(end64_at, kEnd64Size);
  if (little<std::uint32_t>(end64, 0) != kEnd64)
    throw bad(file, "the zip64 end record is not where it should be", end64_at);
  return {little<std::uint64_t>(end64, 48), little<std::uint64_t>(end64, 40),
          little<std::uint64_t>(end64, 32)};
}

/// Sizes or an offset of 0xFFFFFFFF stand in the zip64 extra field instead, in a fixed order [4.5.3].
void read_zip64(std::span<const std::byte> extra, ZipArchive::Member& member) {
  constexpr std::uint64_t kElsewhere = 0xFFFFFFFFu;
  while (extra.size() >= 4) {
    const auto id = little<std::uint16_t>(extra, 0);
    const auto size = little<std::uint16_t>(extra, 2);
    if (size > extra.size() - 4u) return;
    std::span<const std::byte> field = extra.subspan(4, size);
    extra = extra.subspan(4u + size);
    if (id != 1) continue;
    for (std::uint64_t* value : {&member.size, &member.compressed_size, &member.header_offset}) {
      if (*value != kElsewhere || field.size() < 8) continue;
      *value = little<std::uint64_t>(field, 0);
      field = field.subspan(8);
    }
  }
}

/// Inflates a raw deflate stream that must fill `out` exactly.
class Inflater {
 public:
  explicit Inflater(std::span<std::byte> out) : out_(out) {
    if (inflateInit2(&stream_, -MAX_WBITS) != Z_OK)
      throw Error(ErrorKind::kOutOfMemory, "no memory to inflate");
  }
  ~Inflater() { inflateEnd(&stream_); }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;

  /// False if the piece is no valid continuation or would need more room than `out` has.
  [[nodiscard]] bool take(std::span<const std::byte> piece) {
    stream_.next_in = reinterpret_cast<Bytef*>(const_cast<std::byte*>(piece.data()));
    stream_.avail_in = static_cast<uInt>(piece.size());
    while (stream_.avail_in > 0) {
      if (ended_) return false;
      // zlib counts in 32 bits; a spare byte shows whether the stream wants to go on past the end.
      std::byte spare{};
      const std::size_t room = std::min<std::size_t>(out_.size() - done_, std::numeric_limits<uInt>::max());
      stream_.next_out = reinterpret_cast<Bytef*>(room > 0 ? out_.data() + done_ : &spare);
      stream_.avail_out = room > 0 ? static_cast<uInt>(room) : 1u;
      const uInt offered = stream_.avail_out;
      const int code = inflate(&stream_, Z_NO_FLUSH);
      const std::size_t made = offered - stream_.avail_out;
      if (room == 0 && made > 0) return false;
      done_ += made;
      ended_ = code == Z_STREAM_END;
      if (code != Z_OK && !ended_) return false;
    }
    return true;
  }
  [[nodiscard]] bool complete() const noexcept { return ended_ && done_ == out_.size(); }

 private:
  std::span<std::byte> out_;
  z_stream stream_{};
  std::size_t done_ = 0;
  bool ended_ = false;
};

std::uint32_t zip_crc(std::span<const std::byte> bytes) {
  return static_cast<std::uint32_t>(crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

}  // namespace

ZipArchive::ZipArchive(const FileReader& file) : file_(file) {
  const Directory directory = find_directory(file);
  if (directory.size > kMaxDirectory || directory.entries > directory.size / kDirectoryHeaderSize)
    throw bad(file, "the zip directory's size is impossible", directory.offset);
  const std::vector<std::byte> bytes = file.read(directory.offset, static_cast<std::size_t>(directory.size));
  std::span<const std::byte> rest = bytes;
  for (std::uint64_t i = 0; i < directory.entries; ++i) {
    const std::uint64_t at = directory.offset + (bytes.size() - rest.size());
    if (rest.size() < kDirectoryHeaderSize || little<std::uint32_t>(rest, 0) != kDirectoryHeader)
      throw bad(file, "entry " + std::to_string(i) + " of the zip directory is damaged", at);
    const std::size_t name_size = little<std::uint16_t>(rest, 28);
    const std::size_t extra_size = little<std::uint16_t>(rest, 30);
    const std::size_t whole = kDirectoryHeaderSize + name_size + extra_size + little<std::uint16_t>(rest, 32);
    if (whole > rest.size())
      throw bad(file, "entry " + std::to_string(i) + " of the zip directory is cut short", at);
    Member member;
    const std::span<const std::byte> name = rest.subspan(kDirectoryHeaderSize, name_size);
    member.name.assign(reinterpret_cast<const char*>(name.data()), name.size());
    if (has_control_character(member.name) || find_invalid_utf8(member.name))
      throw bad(file, "the name of entry " + std::to_string(i) + " of the zip directory is not a text", at);
    member.crc = little<std::uint32_t>(rest, 16);
    member.compressed_size = little<std::uint32_t>(rest, 20);
    member.size = little<std::uint32_t>(rest, 24);
    member.header_offset = little<std::uint32_t>(rest, 42);
    read_zip64(rest.subspan(kDirectoryHeaderSize + name_size, extra_size), member);
    const auto method = little<std::uint16_t>(rest, 10);
    if ((little<std::uint16_t>(rest, 8) & kEncrypted) != 0)
      throw bad(file, member.name + " is encrypted", at);
    if (method != kStored && method != kDeflated)
      throw bad(file,
                member.name + " is compressed by method " + std::to_string(method) + ", which is not read",
                at);
    member.deflated = method == kDeflated;
    if (!member.deflated && member.size != member.compressed_size)
      throw bad(file, member.name + " is stored, but its two sizes differ", at);
    // Deflate codes at best 258 bytes in two bits; a size beyond that, or beyond the file, would only waste
    // memory.
    if (member.compressed_size > file.size() || member.size / 1032 > member.compressed_size + 1)
      throw bad(file, member.name + " has an impossible size", at);
    if (!index_.emplace(member.name, members_.size()).second)
      throw bad(file, member.name + " comes twice", at);
    members_.push_back(std::move(member));
    rest = rest.subspan(whole);
  }
}

const ZipArchive::Member* ZipArchive::find(std::string_view name) const {
  const auto it = index_.find(name);
  return it == index_.end() ? nullptr : &members_[it->second];
}

std::uint64_t ZipArchive::data_offset(const Member& member) const {
  const std::vector<std::byte> header = file_.read(member.header_offset, kLocalHeaderSize);
  if (little<std::uint32_t>(header, 0) != kLocalHeader)
    throw bad(file_, member.name + " does not start where the zip directory says", member.header_offset);
  const std::size_t name_size = little<std::uint16_t>(header, 26);
  const std::uint64_t name_at = member.header_offset + kLocalHeaderSize;
  const std::vector<std::byte> name = file_.read(name_at, name_size);
  if (std::string_view(reinterpret_cast<const char*>(name.data()), name.size()) != member.name)
    throw bad(file_, member.name + " has another name where it starts", name_at);
  return name_at + name_size + little<std::uint16_t>(header, 28);
}

void ZipArchive::read(const Member& member, std::span<std::byte> out) const {
  const std::uint64_t start = data_offset(member);
  if (out.size() != member.size)
    throw Error(ErrorKind::kInternal, member.name + " was read with a wrong size");
  if (member.deflated) {
    Inflater inflater(out);
    file_.for_each_piece(start, member.compressed_size, [&](std::span<const std::byte> piece) {
      if (!inflater.take(piece))
        throw bad(file_, "the compressed data of " + member.name + " is damaged", start);
    });
    if (!inflater.complete())
      throw bad(file_, "the compressed data of " + member.name + " is cut short", start);
  } else {
    file_.read(start, out);
  }
  if (zip_crc(out) != member.crc)
    throw bad(file_, "the contents of " + member.name + " do not match their checksum: the file is damaged",
              start);
}

}  // namespace slide
