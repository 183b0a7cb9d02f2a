#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

// Messages of Protocol Buffers by hand, for tests of the reader: the other side of
// https://protobuf.dev/programming-guides/encoding.
namespace slide::test {

inline std::string varint(std::uint64_t value) {
  std::string bytes;
  for (; value >= 0x80; value >>= 7U) bytes += static_cast<char>(value | 0x80U);
  return bytes + static_cast<char>(value);
}
inline std::string number(std::uint64_t field, std::int64_t value) {
  return varint(field << 3U) + varint(static_cast<std::uint64_t>(value));
}
inline std::string bytes(std::uint64_t field, const std::string& content) {
  return varint(field << 3U | 2U) + varint(content.size()) + content;
}
template <typename T>
std::string little_endian(const std::vector<T>& values) {
  std::string result(values.size() * sizeof(T), '\0');
  std::memcpy(result.data(), values.data(), result.size());
  return result;
}
inline std::string packed(std::uint64_t field, const std::vector<std::int64_t>& values) {
  std::string content;
  for (const std::int64_t v : values) content += varint(static_cast<std::uint64_t>(v));
  return bytes(field, content);
}

/// A TensorProto of floats as raw data.
inline std::string onnx_tensor(const std::vector<std::int64_t>& extents, const std::vector<float>& values,
                               const std::string& name = "") {
  return packed(1, extents) + number(2, 1) + bytes(8, name) + bytes(9, little_endian(values));
}
/// An AttributeProto of integers, of one integer, of a float, of a text.
inline std::string integers(const std::string& name, const std::vector<std::int64_t>& values) {
  return bytes(5, bytes(1, name) + packed(8, values) + number(20, 7));
}
inline std::string integer(const std::string& name, std::int64_t value) {
  return bytes(5, bytes(1, name) + number(3, value) + number(20, 2));
}
inline std::string real(const std::string& name, float value) {
  return bytes(5, bytes(1, name) + varint(2U << 3U | 5U) + little_endian<float>({value}) + number(20, 1));
}
inline std::string text(const std::string& name, const std::string& value) {
  return bytes(5, bytes(1, name) + bytes(4, value) + number(20, 3));
}
/// A ModelProto of one node; `more` are further fields of the graph.
inline std::string onnx_model(const std::string& op, const std::vector<std::string>& inputs,
                              const std::string& attributes = "", const std::string& more = "") {
  std::string node;
  for (const std::string& input : inputs) node += bytes(1, input);
  node += bytes(2, "y") + bytes(4, op) + attributes;
  return number(1, 8) + bytes(2, "a test") + bytes(7, bytes(1, node) + more) + bytes(8, number(2, 15));
}

}  // namespace slide::test
