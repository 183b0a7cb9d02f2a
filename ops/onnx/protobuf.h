#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace slide::ops {

/// One field of a message of Protocol Buffers (https://protobuf.dev/programming-guides/encoding).
struct ProtobufField {
  enum class Type { kVarint, kFixed64, kBytes, kFixed32 };
  std::uint64_t number = 0;
  Type type = Type::kVarint;
  std::uint64_t value = 0;           ///< of a varint; the bits of a fixed number
  std::span<const std::byte> bytes;  ///< of a text, an inner message or packed numbers

  [[nodiscard]] std::string_view text() const {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  }
};

/// Reads a message field by field. What it is given is hostile: nothing is read beyond its end, and nothing
/// is allocated. Throws Error(kBadInput) naming the file where a field is cut short, a number has more than
/// ten bytes, or there is a type of field that is none.
class ProtobufReader {
 public:
  /// @param file  what messages call it; must outlive the reader, as the bytes must
  ProtobufReader(std::span<const std::byte> message, const std::string& file)
      : rest_(message), size_(message.size()), file_(file) {}

  /// The next field; nothing at the end.
  [[nodiscard]] std::optional<ProtobufField> next();
  [[nodiscard]] bool at_end() const noexcept { return rest_.empty(); }
  /// A number as packed numbers lie behind each other.
  [[nodiscard]] std::uint64_t varint();
  /// `bytes` (4 or 8) little-endian ones.
  [[nodiscard]] std::uint64_t fixed(std::size_t bytes);

 private:
  [[noreturn]] void fail(const std::string& problem) const;
  std::span<const std::byte> take(std::uint64_t bytes);

  std::span<const std::byte> rest_;
  std::size_t size_;
  const std::string& file_;
};

}  // namespace slide::ops
