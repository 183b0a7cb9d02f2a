#include "ops/onnx/protobuf.h"

#include "runtime/error.h"

namespace slide::ops {

void ProtobufReader::fail(const std::string& problem) const {
  throw Error(ErrorKind::kBadInput, file_ + ": " + problem + ", " + std::to_string(size_ - rest_.size()) +
                                        " bytes into a message of " + std::to_string(size_));
}

std::span<const std::byte> ProtobufReader::take(std::uint64_t bytes) {
  if (bytes > rest_.size()) fail("a field is cut short");
  const std::span<const std::byte> taken = rest_.first(static_cast<std::size_t>(bytes));
  rest_ = rest_.subspan(taken.size());
  return taken;
}

std::uint64_t ProtobufReader::varint() {
  std::uint64_t value = 0;
  for (unsigned shift = 0; shift < 70; shift += 7) {
    const auto byte = std::to_integer<std::uint64_t>(take(1)[0]);
    if (shift < 64) value |= (byte & 0x7FU) << shift;
    if (byte < 0x80) return value;
  }
  fail("a number has more than ten bytes");
}

std::uint64_t ProtobufReader::fixed(std::size_t bytes) {
  std::uint64_t value = 0;
  unsigned shift = 0;
  for (const std::byte byte : take(bytes)) {
    value |= std::to_integer<std::uint64_t>(byte) << shift;
    shift += 8;
  }
  return value;
}

std::optional<ProtobufField> ProtobufReader::next() {
  if (at_end()) return std::nullopt;
  const std::uint64_t key = varint();
  ProtobufField field;
  field.number = key >> 3U;
  switch (key & 7U) {
    case 0:
      field.value = varint();
      return field;
    case 1:
      field.type = ProtobufField::Type::kFixed64;
      field.value = fixed(8);
      return field;
    case 2:
      field.type = ProtobufField::Type::kBytes;
      field.bytes = take(varint());
      return field;
    case 5:
      field.type = ProtobufField::Type::kFixed32;
      field.value = fixed(4);
      return field;
    default:
      fail("field " + std::to_string(field.number) + " has an unknown type");
  }
}

}  // namespace slide::ops
