#include "ops/onnx/onnx_file.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "ops/onnx/protobuf.h"
#include "runtime/error.h"

namespace slide::ops {
namespace {

using Type = ProtobufField::Type;
constexpr std::uintmax_t kLargestFile = std::uintmax_t{1} << 26U;

Error bad(const std::string& file, const std::string& problem) {
  return Error(ErrorKind::kBadInput, file + ": " + problem);
}

/// A repeated number, packed or one by one.
template <typename T, typename Next>
void append(std::vector<T>& values, const ProtobufField& field, const std::string& file, const Next& next) {
  if (field.type != Type::kBytes) {
    values.push_back(std::bit_cast<T>(field.value));
    return;
  }
  for (ProtobufReader reader(field.bytes, file); !reader.at_end();)
    values.push_back(std::bit_cast<T>(next(reader)));
}

std::uint64_t next_varint(ProtobufReader& reader) { return reader.varint(); }
std::uint64_t next_double(ProtobufReader& reader) { return reader.fixed(8); }

/// What the fields of a tensor say, before they are put together.
struct RawTensor {
  std::string name;
  std::vector<std::int64_t> extents, integers;
  std::vector<std::uint64_t> floats;  // bits
  std::vector<double> doubles;
  std::uint64_t type = 0;
  std::span<const std::byte> raw;
};

RawTensor fields_of(std::span<const std::byte> bytes, const std::string& file) {
  RawTensor t;
  ProtobufReader reader(bytes, file);
  while (const std::optional<ProtobufField> field = reader.next()) switch (field->number) {
      case 1:
        append(t.extents, *field, file, next_varint);
        break;
      case 2:
        t.type = field->value;
        break;
      case 4:
        append(t.floats, *field, file, [](ProtobufReader& r) { return r.fixed(4); });
        break;
      case 7:
        append(t.integers, *field, file, next_varint);
        break;
      case 8:
        t.name = field->text();
        break;
      case 9:
        t.raw = field->bytes;
        break;
      case 10:
        append(t.doubles, *field, file, next_double);
        break;
      default:
        break;
    }
  return t;
}

Shape shape_of(const RawTensor& t, const std::string& file) {
  if (t.extents.size() > Shape::kMaxRank) throw bad(file, "a tensor has more than five axes");
  std::uint64_t count = 1;
  bool none = false;
  for (const std::int64_t extent : t.extents) {
    if (extent < 0 || extent > std::int64_t{1} << 40U ||
        __builtin_mul_overflow(count, static_cast<std::uint64_t>(std::max<std::int64_t>(1, extent)),
                               &count) ||
        count >> 40U != 0)
      throw bad(file, "the extents of a tensor are negative or too large");
    none = none || extent == 0;
  }
  return none ? Shape{0} : Shape(std::span<const std::int64_t>(t.extents));
}

template <typename T>
std::span<const std::byte> as_bytes_of(const std::vector<T>& values) {
  return std::as_bytes(std::span(values));
}

OnnxAttribute attribute_of(std::span<const std::byte> bytes, const std::string& file, std::string& name) {
  OnnxAttribute a;
  ProtobufReader reader(bytes, file);
  while (const std::optional<ProtobufField> field = reader.next()) switch (field->number) {
      case 1:
        name = field->text();
        break;
      case 2:
        a.number = static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(field->value)));
        break;
      case 3:
        a.integer = static_cast<std::int64_t>(field->value);
        break;
      case 4:
        a.text = field->text();
        break;
      case 8:
        append(a.integers, *field, file, next_varint);
        break;
      default:
        break;
    }
  return a;
}

void add_node(OnnxNode& node, std::span<const std::byte> bytes, const std::string& file) {
  ProtobufReader reader(bytes, file);
  while (const std::optional<ProtobufField> field = reader.next()) {
    if (field->number == 1) node.inputs.emplace_back(field->text());
    if (field->number == 4) node.op = field->text();
    if (field->number != 5) continue;
    std::string name;
    OnnxAttribute attribute = attribute_of(field->bytes, file, name);
    node.attributes.insert_or_assign(name, std::move(attribute));
  }
}

}  // namespace

OnnxTensor parse_onnx_tensor(std::span<const std::byte> bytes, const std::string& file) {
  const RawTensor t = fields_of(bytes, file);
  const Shape shape = shape_of(t, file);
  std::vector<std::uint32_t> floats;
  DType type = DType::kF32;
  std::span<const std::byte> data = t.raw;
  switch (t.type) {
    case 1:
      for (const std::uint64_t bits : t.floats) floats.push_back(static_cast<std::uint32_t>(bits));
      if (data.empty()) data = as_bytes_of(floats);
      break;
    case 7:
      type = DType::kI64;
      if (data.empty()) data = as_bytes_of(t.integers);
      break;
    case 11:
      type = DType::kF64;
      if (data.empty()) data = as_bytes_of(t.doubles);
      break;
    default:
      throw bad(file, "a tensor of ONNX's element type " + std::to_string(t.type) +
                          ": float, double and int64 are read");
  }
  const std::size_t wanted = static_cast<std::size_t>(shape.count()) * size_of(type);
  if (data.size() != wanted)
    throw bad(file, "a tensor of " + shape.text() + " elements has " + std::to_string(data.size()) +
                        " bytes of data, not " + std::to_string(wanted));
  OnnxTensor result{t.name, Tensor(type, shape)};
  if (wanted > 0) std::memcpy(result.values.mutable_raw().data(), data.data(), wanted);
  return result;
}

OnnxNode parse_onnx_node(std::span<const std::byte> model, const std::string& file) {
  OnnxNode node;
  int nodes = 0;
  ProtobufReader reader(model, file);
  while (const std::optional<ProtobufField> field = reader.next()) {
    if (field->number != 7) continue;  // the graph
    ProtobufReader graph(field->bytes, file);
    while (const std::optional<ProtobufField> part = graph.next()) {
      if (part->number == 1 && ++nodes == 1) add_node(node, part->bytes, file);
      if (part->number == 5) node.constants.push_back(parse_onnx_tensor(part->bytes, file));
    }
  }
  if (nodes != 1)
    throw bad(file, "not a test of one operator: the model has " + std::to_string(nodes) + " nodes");
  return node;
}

std::vector<std::byte> read_small_file(const std::string& path) {
  std::error_code code;
  const std::uintmax_t size = std::filesystem::file_size(path, code);
  if (code) throw bad(path, "cannot read the file: " + code.message());
  if (size > kLargestFile) throw bad(path, "larger than 64 MiB");
  std::vector<std::byte> bytes(static_cast<std::size_t>(size));
  std::ifstream file(path, std::ios::binary);
  file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size));
  if (!file) throw bad(path, "cannot read the file");
  return bytes;
}

}  // namespace slide::ops
