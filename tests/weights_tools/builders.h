#pragma once

// The smallest zip archives and pickles that a checkpoint can be made of, written by hand so that any part of
// them can be wrong.

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tests/temporary_folder.h"

template <typename T>
std::string little(T value) {
  std::string bytes(sizeof value, '\0');
  std::memcpy(bytes.data(), &value, sizeof value);
  return bytes;
}
inline std::string u16(std::uint64_t value) { return little(static_cast<std::uint16_t>(value)); }
inline std::string u32(std::uint64_t value) { return little(static_cast<std::uint32_t>(value)); }
inline std::string u64(std::uint64_t value) { return little(value); }

// --- zip

/// CRC-32 by its definition.
inline std::uint32_t zip_crc_of(std::string_view text) {
  std::uint32_t crc = 0xFFFFFFFFu;
  for (const char c : text) {
    crc ^= static_cast<unsigned char>(c);
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (0xEDB88320u & (0u - (crc & 1u)));
  }
  return ~crc;
}

struct ZipMember {
  std::string name;
  std::string contents;
  std::uint16_t flags = 0;
  std::uint16_t method = 0;
  std::uint64_t claimed_size =
      ~std::uint64_t{0};  ///< of the contents, in the directory; default: the true one
};

/// An archive of stored members. With `zip64` all sizes and offsets stand in the zip64 records.
inline std::string zip_of(const std::vector<ZipMember>& members, bool zip64 = false) {
  std::string file;
  std::string directory;
  for (const ZipMember& m : members) {
    const std::uint64_t size = m.claimed_size == ~std::uint64_t{0} ? m.contents.size() : m.claimed_size;
    const std::uint64_t offset = file.size();
    const std::string crc = u32(zip_crc_of(m.contents));
    const std::string extra = zip64 ? u16(0x7777) + u16(2) + "xx" + u16(1) + u16(24) + u64(size) +
                                          u64(m.contents.size()) + u64(offset)
                                    : "";
    const auto shown = [&](std::uint64_t value) { return u32(zip64 ? 0xFFFFFFFFu : value); };
    file += "PK\3\4" + u16(20) + u16(m.flags) + u16(m.method) + u32(0) + crc + u32(m.contents.size()) +
            u32(size) + u16(m.name.size()) + u16(3) + m.name + "abc" + m.contents;
    directory += "PK\1\2" + u16(20) + u16(20) + u16(m.flags) + u16(m.method) + u32(0) + crc +
                 shown(m.contents.size()) + shown(size) + u16(m.name.size()) + u16(extra.size()) + u16(4) +
                 u16(0) + u16(0) + u32(0) + shown(offset) + m.name + extra + "note";
  }
  const std::uint64_t start = file.size();
  file += directory;
  if (zip64) {
    const std::uint64_t end64 = file.size();
    file += "PK\6\6" + u64(44) + u16(45) + u16(45) + u32(0) + u32(0) + u64(members.size()) +
            u64(members.size()) + u64(directory.size()) + u64(start) + "PK\6\7" + u32(0) + u64(end64) +
            u32(1);
  }
  const std::uint64_t shown_count = zip64 ? 0xFFFFu : members.size();
  return file + "PK\5\6" + u16(0) + u16(0) + u16(shown_count) + u16(shown_count) +
         u32(zip64 ? 0xFFFFFFFFu : directory.size()) + u32(zip64 ? 0xFFFFFFFFu : start) + u16(7) + "comment";
}

// --- pickle

inline std::string op(int code) { return {static_cast<char>(code)}; }
inline std::string text(std::string_view value) { return "X" + u32(value.size()) + std::string(value); }
inline std::string integer(std::int64_t value) {
  return op(0x8a) + op(8) + u64(static_cast<std::uint64_t>(value));  // LONG1
}
inline std::string global(std::string_view module, std::string_view name) {
  return "c" + std::string(module) + "\n" + std::string(name) + "\n";
}
inline std::string tuple(const std::vector<std::int64_t>& values) {
  std::string bytes = "(";
  for (const std::int64_t value : values) bytes += integer(value);
  return bytes + "t";
}
inline std::string storage(std::string_view key, std::int64_t count, std::string_view type = "FloatStorage",
                           const std::string& view = "") {
  return "(" + text("storage") + global("torch", type) + text(key) + text("cpu") + integer(count) + view +
         "tQ";
}
inline std::string tensor(const std::string& storage, std::int64_t offset,
                          const std::vector<std::int64_t>& sizes, const std::vector<std::int64_t>& strides) {
  return global("torch._utils", "_rebuild_tensor_v2") + "(" + storage + integer(offset) + tuple(sizes) +
         tuple(strides) + op(0x89) + global("collections", "OrderedDict") + ")RtR";
}
inline std::string pickle(const std::string& body) { return op(0x80) + op(2) + body + "."; }
/// {name: value}
inline std::string dict(std::string_view name, const std::string& value) {
  return "}" + text(name) + value + "s";
}

/// A zip checkpoint of that pickle and one storage "0".
inline std::string checkpoint_of(const std::string& pickled,
                                 const std::string& data = std::string(24, '\0')) {
  return zip_of({{"a/data.pkl", pickled}, {"a/data/0", data}, {"a/version", "3\n"}});
}

/// A stream checkpoint of that pickle and its storages.
inline std::string stream_of(const std::string& pickled,
                             const std::vector<std::pair<std::string, std::string>>& storages,
                             const std::vector<std::uint64_t>& counts) {
  std::string file = op(0x80) + op(2) + op(0x8a) + op(10);
  for (const int c : {0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19}) file += op(c);
  file += "." + pickle("M" + u16(1001)) + pickle(dict("little_endian", op(0x88))) + pickled;
  std::string keys = "](";
  for (const auto& entry : storages) keys += text(entry.first);
  file += pickle(keys + "e");
  for (std::size_t i = 0; i < storages.size(); ++i) file += u64(counts[i]) + storages[i].second;
  return file;
}

inline void write_text(const std::string& path, const std::string& bytes) {
  write_bytes(path, std::as_bytes(std::span(bytes)));
}
