#include "runtime/safetensors.h"

#include <doctest/doctest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "runtime/error.h"
#include "runtime/safetensors_writer.h"
#include "tests/temporary_folder.h"

using namespace slide;

namespace {

using Named = std::vector<std::pair<std::string, Tensor>>;

/// One tensor of each dtype, of each rank, one without elements, and a name beyond ASCII.
Named samples() {
  Named all;
  int salt = 0;
  const auto add = [&](const std::string& name, DType type, const Shape& shape) {
    Tensor t(type, shape);
    for (std::byte& b : t.mutable_raw()) b = static_cast<std::byte>((salt = (salt * 73 + 41) % 251) & 0x3F);
    all.emplace_back(name, std::move(t));
  };
  add("flag", DType::kBool, {3});
  add("half", DType::kF16, {3, 1});
  add("double", DType::kF64, {1, 2, 1});
  add("brain", DType::kBF16, {5});
  add("conv.weight", DType::kF32, {2, 1, 1, 2});
  add("steps", DType::kI64, {});
  add("i32", DType::kI32, {1, 1, 1, 1, 2});
  add("i16", DType::kI16, {1});
  add("i8", DType::kI8, {1});
  add("u8", DType::kU8, {3});
  add("none", DType::kF32, {0, 4});
  add("gewölbe \"quoted\\\"", DType::kF32, {1});
  return all;
}

bool same(const Tensor& a, const Tensor& b) {
  return a.dtype() == b.dtype() && a.shape() == b.shape() &&
         std::memcmp(a.raw().data(), b.raw().data(), a.bytes()) == 0;
}

bool holds(const SafetensorsFile& file, const Named& wanted) {
  if (file.tensors().size() != wanted.size()) return false;
  for (const auto& [name, tensor] : wanted)
    if (!file.contains(name) || !same(file.tensor(name), tensor)) return false;
  return true;
}

std::vector<std::byte> written(const Named& tensors, const Metadata& metadata = {}) {
  const TemporaryFolder folder;
  write_safetensors(folder.file("w.safetensors"), tensors, metadata);
  CHECK(folder.entries() == 1);
  return bytes_of_file(folder.file("w.safetensors"));
}

/// A file made of a header's text and so many bytes of data.
std::vector<std::byte> file_of(const std::string& header, std::size_t data_bytes) {
  const std::uint64_t length = header.size();
  std::vector<std::byte> bytes(8 + header.size() + data_bytes);
  std::memcpy(bytes.data(), &length, 8);
  std::memcpy(bytes.data() + 8, header.data(), header.size());
  return bytes;
}

/// The message with which a file is refused; "accepted" if it is not.
std::string refusal(std::span<const std::byte> bytes) {
  try {
    static_cast<void>(SafetensorsFile::from_memory(bytes, "w"));
  } catch (const Error& e) {
    CHECK(e.kind() == ErrorKind::kBadWeights);
    return e.what();
  }
  return "accepted";
}
std::string refusal(const std::string& header, std::size_t data_bytes) {
  return refusal(file_of(header, data_bytes));
}

std::uint64_t data_start(std::span<const std::byte> bytes) {
  std::uint64_t length = 0;
  std::memcpy(&length, bytes.data(), sizeof length);
  return 8 + length;
}

}  // namespace

TEST_CASE("a safetensors file gives back what was written: every dtype, rank and name, and the metadata") {
  const TemporaryFolder folder;
  const Named tensors = samples();
  const Metadata metadata = {{"model", "a \"model\"\n"}, {"licence", "CC0"}};
  write_safetensors(folder.file("w.safetensors"), tensors, metadata);
  const SafetensorsFile file = SafetensorsFile::open(folder.file("w.safetensors"));
  CHECK(holds(file, tensors));
  for (const auto& [key, value] : metadata) CHECK(file.metadata().at(key) == value);
  for (std::size_t i = 0; i < tensors.size(); ++i) CHECK(file.names()[i] == tensors[i].first);
  CHECK(file.info("half").shape == Shape{3, 1});
  CHECK(file.has_checksums());
  CHECK(file.verify_crc() == tensors.size());
  file.check_finite();
  CHECK_THROWS_WITH_AS(static_cast<void>(file.tensor("conv.bias")), doctest::Contains("no tensor conv.bias"),
                       Error);
}

TEST_CASE("the writer aligns the data to 64 bytes and every tensor to its element") {
  const std::vector<std::byte> bytes = written(samples());
  CHECK(data_start(bytes) % 64 == 0);
  const SafetensorsFile file = SafetensorsFile::from_memory(bytes, "w");
  for (const TensorInfo& info : file.tensors()) {
    const std::byte* data = file.tensor(info.name).raw().data();
    CHECK(data >= bytes.data());  // a view of the file: nothing had to be copied
    CHECK(data <= bytes.data() + bytes.size());
  }
}

TEST_CASE("a tensor of a file outlives the file") {
  const TemporaryFolder folder;
  const Named tensors = samples();
  write_safetensors(folder.file("w"), tensors);
  const Tensor kept = SafetensorsFile::open(folder.file("w")).tensor("conv.weight");
  std::filesystem::remove(folder.file("w"));
  CHECK(same(kept, tensors[4].second));
}

TEST_CASE("a released tensor gives its memory back and can be read again") {
  const auto resident_kib = [] {  // pages of files in memory
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);)
      if (line.starts_with("RssFile:")) return std::stol(line.substr(8));
    return 0L;
  };
  const TemporaryFolder folder;
  const Tensor large = Tensor::zeros(DType::kF32, {1 << 20});
  const Tensor small = Tensor::from<float>({1}, std::vector<float>{7});
  write_safetensors(folder.file("w"), {{"large", large}, {"small", small}});
  const SafetensorsWeights weights(folder.file("w"));
  const Tensor kept = *weights.find("large", {1 << 20});
  CHECK(same(kept, large));
  const long before = resident_kib();
  weights.release("large");
  if (before > 0) CHECK(resident_kib() <= before - 3800);
  CHECK(same(kept, large));
  CHECK(same(*weights.find("small", {1}), small));
  CHECK_THROWS_AS(weights.release("none"), Error);
  const long again = resident_kib();
  weights.release();
  if (again > 0) CHECK(resident_kib() <= again - 3800);
  CHECK(same(kept, large));
  CHECK(same(*weights.find("small", {1}), small));
}

TEST_CASE("the writer takes tensors in pieces and refuses too much, too little and impossible names") {
  const TemporaryFolder folder;
  const std::vector<TensorInfo> list = {
      {"a", DType::kF32, {3}}, {"none", DType::kF32, {0}}, {"b", DType::kF64, {1}}};
  const std::vector<std::byte> data(20, std::byte{7});
  const std::span<const std::byte> bytes(data);
  {
    SafetensorsWriter writer(folder.file("w"), list, {});
    writer.write(bytes.first(5));
    writer.write(bytes.first(7));
    CHECK_THROWS_AS(writer.write(bytes.first(9)), Error);
    CHECK_THROWS_WITH_AS(writer.finish(), doctest::Contains("tensor b is not complete"), Error);
    writer.write(bytes.first(8));
    writer.finish();
  }
  CHECK(SafetensorsFile::open(folder.file("w")).verify_crc() == 3);
  CHECK_THROWS_AS(SafetensorsWriter(folder.file("x"), {list[0], list[0]}, {}), Error);
  CHECK_THROWS_AS(SafetensorsWriter(folder.file("x"), {{"a\nb", DType::kF32, {}}}, {}), Error);
  CHECK_THROWS_AS(SafetensorsWriter(folder.file("x"), {{"a\xFF", DType::kF32, {}}}, {}), Error);
  CHECK_THROWS_AS(SafetensorsWriter(folder.file("x"), list, {{"crc32c.a", "0"}}), Error);
  CHECK(folder.entries() == 1);
}

TEST_CASE("a file cut at any byte is refused") {
  const std::vector<std::byte> whole = written(samples());
  for (std::size_t length = 0; length < whole.size(); ++length) {
    const std::vector<std::byte> cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length));
    const std::string message = refusal(cut);
    REQUIRE_MESSAGE(message != "accepted", length);
    REQUIRE_MESSAGE(message.find("cut short") != std::string::npos, message);
  }
  std::vector<std::byte> longer = whole;
  longer.push_back(std::byte{0});
  CHECK(refusal(longer).find("1 bytes after the last tensor") != std::string::npos);
}

TEST_CASE("flipping any bit gives an error or the identical tensors") {
  const Named tensors = samples();
  std::vector<std::byte> bytes = written(tensors, {{"model", "m"}});
  std::size_t accepted = 0;
  for (std::size_t bit = 0; bit < bytes.size() * 8; ++bit) {
    const auto mask = static_cast<std::byte>(1u << (bit % 8));
    bytes[bit / 8] ^= mask;
    try {
      const SafetensorsFile file = SafetensorsFile::from_memory(bytes, "w");
      const bool header = bit / 8 < data_start(bytes);
      if (!header) CHECK_THROWS_AS(file.verify_crc(), Error);
      if (header) REQUIRE_MESSAGE(holds(file, tensors), bit);
      accepted += header ? 1 : 0;
    } catch (const Error& e) {
      REQUIRE(e.kind() == ErrorKind::kBadWeights);
    }
    bytes[bit / 8] ^= mask;
  }
  CHECK(accepted > 0);  // the model's name, say, is not protected
}

TEST_CASE("a changed value is found by its tensor's checksum, which names tensor and bytes") {
  std::vector<std::byte> bytes =
      written({{"a", Tensor::zeros(DType::kF32, {8})}, {"b", Tensor::zeros(DType::kF32, {8})}});
  const std::uint64_t start = data_start(bytes);
  bytes[static_cast<std::size_t>(start) + 40] ^= std::byte{1};
  CHECK_THROWS_WITH_AS(SafetensorsFile::from_memory(bytes, "w").verify_crc(),
                       doctest::Contains(("tensor b: its data does not match its checksum (bytes " +
                                          std::to_string(start + 32) + " to " + std::to_string(start + 64))
                                             .c_str()),
                       Error);
}

TEST_CASE("NaN and infinities are found on request, with tensor, element and byte") {
  for (const DType type : {DType::kF64, DType::kF32, DType::kF16, DType::kBF16}) {
    for (const double value :
         {std::numeric_limits<double>::quiet_NaN(), -std::numeric_limits<double>::infinity()}) {
      std::vector<double> values(9, -1.5);
      values[7] = value;
      const std::vector<std::byte> bytes = written(
          {{"fine", Tensor::zeros(type, {2})}, {"bad", Tensor::from<double>({3, 3}, values).to(type)}});
      const SafetensorsFile file = SafetensorsFile::from_memory(bytes, "w");
      const std::string at = std::to_string(data_start(bytes) + 9 * size_of(type));
      CHECK_THROWS_WITH_AS(
          file.check_finite(),
          doctest::Contains(("tensor bad: element 7 is not a finite number (byte " + at).c_str()), Error);
    }
    std::vector<double> largest(1, type == DType::kF16 ? 65504.0 : 3e38);
    SafetensorsFile::from_memory(written({{"a", Tensor::from<double>({1}, largest).to(type)}}), "w")
        .check_finite();
  }
}

TEST_CASE("data that another writer left misaligned is copied, not read misaligned") {
  const std::string entries =
      R"({"a":{"dtype":"U8","shape":[1],"data_offsets":[0,1]},"b":{"dtype":"F64","shape":[2],"data_offsets":[1,17]}})";
  for (std::size_t padding = 0; padding < 8; ++padding) {
    std::vector<std::byte> bytes = file_of(entries + std::string(padding, ' '), 17);
    const double value = 0.1;
    std::memcpy(bytes.data() + bytes.size() - 8, &value, 8);
    const Tensor b = SafetensorsFile::from_memory(bytes, "w").tensor("b");
    CHECK(reinterpret_cast<std::uintptr_t>(b.raw().data()) % 8 == 0);
    CHECK(b.data<double>()[1] == 0.1);
  }
}

TEST_CASE("every malformed header is refused with a message of its own, naming file, tensor and byte") {
  const auto tensor = [](const std::string& fields) { return R"({"conv.weight":{)" + fields + "}}"; };
  const auto sized = [&](const std::string& shape, const std::string& offsets) {
    return tensor(R"("dtype":"F32","shape":)" + shape + R"(,"data_offsets":)" + offsets);
  };
  CHECK(refusal(sized("[2]", "[0,8]"), 8) == "accepted");
  CHECK(refusal("{}", 0) == "accepted");
  CHECK(refusal("{}   ", 0) == "accepted");
  CHECK(refusal(R"({"__metadata__":{"a":"b"}})", 0) == "accepted");

  struct Case {
    std::string header;
    std::size_t data;
    const char* message;
  };
  const std::string deep(100000, '[');
  std::string deep_objects = R"({"a":)";
  for (int i = 0; i < 10000; ++i) deep_objects += R"({"a":)";
  const std::vector<Case> cases = {
      {"", 0, R"(does not start with "{" (byte 8))"},
      {" {}", 0, R"(does not start with "{" (byte 8))"},
      {"[]", 0, R"(does not start with "{" (byte 8))"},
      {"{", 0, "the header is not valid JSON (byte 9)"},
      {"{}{}", 0, "the header is not valid JSON (byte 10)"},
      {"{} x", 0, "the header is not valid JSON (byte 11)"},
      {R"({"a)"
       "\xFF"
       R"(":{}})",
       0, "the header is not UTF-8 (byte 11)"},
      {R"({"a)"
       "\xC0\xAF"
       R"(":{}})",
       0, "the header is not UTF-8 (byte 11)"},
      {R"({"a)"
       "\xED\xA0\x80"
       R"(":{}})",
       0, "the header is not UTF-8 (byte 11)"},
      {R"({"\ud800":{}})", 0, "the header is not valid JSON"},
      {R"({"a\u0000b":{}})", 0, "holds a control character"},
      {R"({"a\u001b[31m":{}})", 0, "holds a control character"},
      {R"({")" + std::string(2000, 'n') + R"(":{}})", 0, "name is longer than"},
      {R"({"a":1})", 0, "tensor a: a number is not allowed here: an entry must be an object"},
      {R"({"a":null})", 0, "an entry must be an object"},
      {R"({"a":)" + deep, 0, "tensor a: an array is not allowed here"},
      {deep_objects, 0, "tensor a: unknown key \"a\""},
      {tensor(R"("shape":)" + deep), 0, "an array is not allowed here"},
      {tensor(""), 0, "tensor conv.weight: has no \"dtype\""},
      {tensor(R"("dtype":"F32","data_offsets":[0,0])"), 0, "has no \"shape\""},
      {tensor(R"("dtype":"F32","shape":[0])"), 0, "has no \"data_offsets\""},
      {tensor(R"("dtype":"F32","dtype":"F32")"), 0, "the key \"dtype\" comes twice"},
      {tensor(R"("type":"F32")"), 0, "unknown key \"type\""},
      {tensor(R"("dtype":"F31")"), 0, "unknown dtype \"F31\""},
      {tensor(R"("dtype":"f32")"), 0, "unknown dtype \"f32\""},
      {tensor(R"("dtype":32)"), 0, "dtype must be a string"},
      {tensor(R"("dtype":["F32"])"), 0, "dtype must be a string"},
      {tensor(R"("shape":3)"), 0, "must be arrays of whole numbers"},
      {sized("[-2]", "[0,8]"), 8, "a negative number is not allowed here"},
      {sized("[2.0]", "[0,8]"), 8, "the number 2.0"},
      {sized("[2e0]", "[0,8]"), 8, "the number 2e0"},
      {sized("[18446744073709551617]", "[0,8]"), 8, "the number 18446744073709551617"},
      {sized("[\"2\"]", "[0,8]"), 8, "a string is not allowed here"},
      {sized("[true]", "[0,8]"), 8, "a truth value is not allowed here"},
      {sized("[1,1,1,1,1,2]", "[0,8]"), 8, "has more than five dimensions"},
      {sized("[4294967296,4294967296]", "[0,0]"), 0, "the product of its dimensions is too large"},
      {sized("[9223372036854775808,2]", "[0,0]"), 0, "the product of its dimensions is too large"},
      {sized("[0,18446744073709551615]", "[0,0]"), 0, "the product of its dimensions is too large"},
      {sized("[2]", "[0]"), 8, "data_offsets needs two numbers"},
      {sized("[2]", "[0,8,8]"), 8, "data_offsets has more than two numbers"},
      {sized("[2]", "[0,4]"), 4, "do not fit F32 of shape 2, which takes 8 bytes"},
      {sized("[2]", "[8,0]"), 8, "do not fit F32 of shape 2"},
      {sized("[2]", "[18446744073709551608,0]"), 8, "do not fit F32 of shape 2"},
      {sized("[2]", "[0,8]"), 7, "tensor conv.weight ends at byte 8 of the data, of which there are 7 bytes"},
      {sized("[2]", "[0,8]"), 9, "1 bytes after the last tensor belong to no tensor"},
      {sized("[2]", "[1,9]"), 9,
       "1 bytes between the start of the data and tensor conv.weight belong to no tensor"},
      {R"({"a":{"dtype":"U8","shape":[2],"data_offsets":[0,2]},"b":{"dtype":"U8","shape":[2],"data_offsets":[1,3]}})",
       3, "tensor b overlaps tensor a"},
      {R"({"a":{"dtype":"U8","shape":[2],"data_offsets":[0,2]},"b":{"dtype":"U8","shape":[2],"data_offsets":[3,5]}})",
       5, "1 bytes between tensor a and tensor b belong to no tensor"},
      {R"({"a":{"dtype":"U8","shape":[0],"data_offsets":[0,0]},"a":{"dtype":"U8","shape":[0],"data_offsets":[0,0]}})",
       0, "tensor a: the name comes twice"},
      {R"({"__metadata__":{"a":"1","a":"2"}})", 0, "the metadata: the key \"a\" comes twice"},
      {R"({"__metadata__":{"a":1}})", 0, "metadata values must be strings"},
      {R"({"__metadata__":{"a":{}}})", 0, "metadata values must be strings"},
      {R"({"__metadata__":{"crc32c":"00000001"}})", 0, "do not match their checksum"},
      {R"({"__metadata__":{"crc32c.a":"00000000"}})", 0, "but there is no such tensor"},
  };
  for (const Case& c : cases) {
    const std::string message = refusal(c.header, c.data);
    CHECK_MESSAGE(message.find(c.message) != std::string::npos,
                  (message + "  WANTED  " + c.message).substr(0, 400));
    CHECK(message.starts_with("w: "));
    CHECK(message.find("byte ") != std::string::npos);
    CHECK(message.size() < 400);
  }
}

TEST_CASE("a header longer than the format allows, or than the file, is refused before it is read") {
  std::vector<std::byte> bytes = file_of("{}", 0);
  const auto with_length = [&](std::uint64_t length) {
    std::memcpy(bytes.data(), &length, 8);
    return refusal(bytes);
  };
  CHECK(with_length(100'000'001).find("more than the format's 100000000") != std::string::npos);
  CHECK(with_length(~std::uint64_t{0}).find("more than the format's 100000000") != std::string::npos);
  CHECK(with_length(3).find("the file ends at byte 10") != std::string::npos);
  CHECK(with_length(2) == "accepted");
}

TEST_CASE("a well-known kind of file that is none is called what it is, with what to do") {
  const TemporaryFolder folder;
  const std::string path = folder.file("w");
  const auto message_of = [&](const std::string& contents) -> std::string {
    write_bytes(path, std::as_bytes(std::span(contents)));
    try {
      static_cast<void>(SafetensorsFile::open(path));
    } catch (const Error& e) {
      return e.what();
    }
    return "accepted";
  };
  using namespace std::string_literals;
  CHECK(message_of("\n<!DOCTYPE HTML><html><head>").starts_with(path + ": this is a web page (the server"));
  CHECK(message_of("<HTML><title>").starts_with(path + ": this is a web page"));
  CHECK(message_of("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a")
            .starts_with(path + ": this is a Git LFS pointer (the data is not in the clone: get it with"));
  CHECK(message_of("pack/" + std::string(252, '\0') + "ustar\0"s).find("a tar archive (unpack") !=
        std::string::npos);
  CHECK(message_of("\x1F\x8B\x08\0\0\0\0\0\0\x03"s).find("a gzip archive (unpack") != std::string::npos);
  CHECK(message_of("\x08\x07\x12\x07pytorch\x1A\x05"
                   "2.1.0")
            .find("an ONNX model (give the") != std::string::npos);
  CHECK(message_of("PK\3\4\0\0\0\0archive/data.pkl"s).find("slide_convert reads those") != std::string::npos);
  CHECK(message_of("\x89HDF\r\n\x1A\n" + std::string(100, '\0')).find("an HDF5 file") != std::string::npos);
  // A header as long as gzip's first bytes say is none of it.
  const std::string header = "{" + std::string(0x8B1F - 2, ' ') + "}";
  CHECK(message_of("\x1F\x8B\0\0\0\0\0\0"s + header) == "accepted");
}

TEST_CASE("what is not a regular file cannot be opened as weights") {
  const TemporaryFolder folder;
  CHECK_THROWS_WITH_AS(SafetensorsFile::open(folder.file("none")), doctest::Contains("No such file"), Error);
  CHECK_THROWS_WITH_AS(SafetensorsFile::open(folder.path().string()), doctest::Contains("not a regular file"),
                       Error);
  CHECK_THROWS_WITH_AS(SafetensorsFile::open("/dev/null"), doctest::Contains("not a regular file"), Error);
  write_bytes(folder.file("empty"), {});
  CHECK_THROWS_WITH_AS(SafetensorsFile::open(folder.file("empty")), doctest::Contains("0 bytes cannot hold"),
                       Error);
}

TEST_CASE("a safetensors file can be a graph's weights") {
  const std::vector<std::byte> bytes =
      written({{"weight", Tensor::from<float>({2}, std::vector<float>{1.0F, 2.0F})}});
  const SafetensorsWeights weights(SafetensorsFile::from_memory(bytes, "my weights"));
  CHECK(weights.description() == "my weights");
  CHECK(weights.names() == std::vector<std::string>{"weight"});
  CHECK(weights.find("weight", {2})->data<float>()[1] == 2.0F);
  CHECK(!weights.find("bias", {2}));
}
