#include <doctest/doctest.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "runtime/error.h"
#include "tests/temporary_folder.h"
#include "tests/weights_tools/builders.h"
#include "weights_tools/prefix.h"
#include "weights_tools/weight_reader.h"

using namespace slide;

namespace {

const std::string kFolder = SLIDE_TEST_DATA "/checkpoints/";

/// Number of tensors of `reader` that are not as in `wanted`, and those that are missing.
std::size_t differences(const WeightReader& reader, const WeightReader& wanted) {
  std::size_t different = std::max(reader.tensors().size(), wanted.tensors().size());
  for (std::size_t i = 0; i < reader.tensors().size(); ++i) {
    const TensorInfo& info = reader.tensors()[i];
    const auto found = std::ranges::find(wanted.tensors(), info.name, &TensorInfo::name);
    if (found == wanted.tensors().end() || found->dtype != info.dtype || found->shape != info.shape) continue;
    const Tensor a = load(reader, i);
    const Tensor b = load(wanted, static_cast<std::size_t>(found - wanted.tensors().begin()));
    if (std::memcmp(a.raw().data(), b.raw().data(), a.bytes()) == 0) --different;
  }
  return different;
}

/// Opens a checkpoint and reads all of it; the message with which it is refused, or "accepted".
std::string refusal(const std::string& path, const std::string& key = "") {
  try {
    const std::unique_ptr<WeightReader> reader = open_weights(path, key);
    for (std::size_t i = 0; i < reader->tensors().size(); ++i) static_cast<void>(load(*reader, i));
  } catch (const Error& e) {
    CHECK(e.kind() == ErrorKind::kBadWeights);
    const std::string message = e.what();
    CHECK(message.find(path) != std::string::npos);
    CHECK(message.size() < path.size() + 800);
    return message;
  }
  return "accepted";
}

std::string refusal_of(const std::string& contents, const std::string& key = "") {
  const TemporaryFolder folder;
  write_text(folder.file("x.pt"), contents);
  return refusal(folder.file("x.pt"), key);
}

std::string refusal_of_pickle(const std::string& body) { return refusal_of(checkpoint_of(pickle(body))); }

void check_refused(const std::string& body, const std::string& message) {
  const std::string found = refusal_of_pickle(body);
  CHECK_MESSAGE(found.find(message) != std::string::npos, (found + "  WANTED  " + message));
}

std::string text_of(const std::string& name) {
  const std::vector<std::byte> bytes = bytes_of_file(name.starts_with('/') ? name : kFolder + name);
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

const std::string kTensor = tensor(storage("0", 6), 0, {2, 3}, {3, 1});
const std::string kOrderedDict = global("collections", "OrderedDict");

}  // namespace

TEST_CASE("every form of checkpoint gives the tensors that PyTorch itself gives") {
  const std::unique_ptr<WeightReader> expected = open_weights(kFolder + "expected.safetensors");
  CHECK(expected->tensors().size() == 26);
  for (const char* name :
       {"zip.pt", "zip_protocol4.pt", "deflated.pt", "stream.pt", "nested_zip.pt", "nested_stream.pt"}) {
    CAPTURE(name);
    std::unique_ptr<WeightReader> reader = open_weights(kFolder + name);
    if (reader->tensors().front().name.starts_with("module."))
      reader = without_prefix(std::move(reader), "module.");
    CHECK(differences(*reader, *expected) == 0);
    CHECK(reader->format() ==
          (std::string(name).find("stream") == std::string::npos ? "PyTorch zip" : "PyTorch stream"));
  }
}

TEST_CASE("the set of tensors can be chosen, and must be where none is the usual one") {
  CHECK(open_weights(kFolder + "nested_zip.pt", "D")->tensors()[0].name == "x");
  CHECK(open_weights(kFolder + "several.pt", "b")->tensors()[0].name == "y");
  CHECK(refusal(kFolder + "several.pt").find(R"("a" (1 tensors), "b" (1 tensors) (choose one with --key))") !=
        std::string::npos);
  CHECK(refusal(kFolder + "several.pt", "c").find(R"(no tensors under "c", but under "a")") !=
        std::string::npos);
}

TEST_CASE("a checkpoint cut at any byte is refused") {
  const TemporaryFolder folder;
  for (const char* name : {"tiny_zip.pt", "tiny_stream.pt", "stream.pt"}) {
    const std::string path = folder.file(name);
    write_text(path, text_of(name));
    for (std::size_t length = text_of(name).size(); length-- > 0;) {
      std::filesystem::resize_file(path, length);
      REQUIRE_MESSAGE(refusal(path) != "accepted", name << " cut to " << length);
    }
  }
}

TEST_CASE("a flipped bit in a zip checkpoint is found or changes nothing") {
  const TemporaryFolder folder;
  for (const char* name : {"tiny_zip.pt", "deflated.pt"}) {
    const std::unique_ptr<WeightReader> expected = open_weights(kFolder + name);
    const std::string path = folder.file(name);
    const std::string bytes = text_of(name);
    write_text(path, bytes);
    for (std::size_t bit = 0; bit < bytes.size() * 8; bit += bytes.size() < 1000 ? 1 : 11) {
      flip_bit(path, bit);
      if (refusal(path) == "accepted")
        REQUIRE_MESSAGE(differences(*open_weights(path), *expected) == 0, name << " bit " << bit);
      flip_bit(path, bit);
    }
    REQUIRE(text_of(path) == bytes);
  }
}

TEST_CASE(
    "a flipped bit in a stream checkpoint, which has no checksums, is an error or another value, never "
    "worse") {
  const TemporaryFolder folder;
  for (const char* name : {"tiny_stream.pt", "nested_stream.pt"}) {
    const std::string path = folder.file(name);
    const std::string bytes = text_of(name);
    write_text(path, bytes);
    std::size_t refused = 0;
    for (std::size_t bit = 0; bit < bytes.size() * 8; bit += bytes.size() < 1000 ? 1 : 11) {
      flip_bit(path, bit);
      refused += refusal(path) == "accepted" ? 0 : 1;
      flip_bit(path, bit);
    }
    CHECK(refused > bytes.size() / 8);
  }
}

TEST_CASE(
    "nothing that a pickle asks for is called, and a checkpoint of nothing else is refused by its name") {
  const std::string call = "(" + text("echo harm") + "tR";
  check_refused(global("os", "system") + call,
                "holds no dictionary of tensors, but objects of os.system (save the network's state_dict()");
  check_refused(text("os") + text("system") + op(0x93) + call, "but objects of os.system");
  check_refused(global("o\x1b[31ms", "\xFF") + call, "but objects of (not a text)");
  check_refused(global("o\x1b[31ms", "x") + call, "but objects of o?[31ms.x");
  check_refused(global(std::string(600, 'x'), "x") + call, "a global's name is too long");
  // INST, OBJ, EXT1, PERSID, GLOBAL by protocol 0's text arguments, BUILD of an arbitrary object
  for (const int code : std::initializer_list<int>{'i', 'o', 0x82, 0x83, 0x84, 'P', 'S', 'V', 'I', 'F', 'L',
                                                   'd', 'l', 'p', 'g', '0', '2', 0x00, 0xff})
    CHECK(refusal_of_pickle("}" + op(code) + "os\nsystem\n").find("is not allowed") != std::string::npos);
  check_refused("]}b", "attributes are set in something that is not a dictionary");
}

TEST_CASE("objects beside weights stay opaque, and the weights are had") {
  const TemporaryFolder folder;
  const std::string path = folder.file("x.pt");
  const std::string state = "}" + text("lr") + integer(1) + "s";
  const std::string made = global("argparse", "Namespace") + ")" + op(0x81) + state + "b";
  const std::string called = global("os", "system") + "(" + text("echo harm") + "tR";
  const std::string list = global("collections", "deque") + ")R(" + integer(1) + "e";
  write_text(path, checkpoint_of(pickle(dict("args", made) + text("c") + called + "s" + text("d") + list +
                                        "s" + text("state_dict") + dict("w", kTensor) + "s")));
  const std::unique_ptr<WeightReader> reader = open_weights(path);
  REQUIRE(reader->tensors().size() == 1);
  CHECK(reader->tensors()[0].name == "w");
}

TEST_CASE("a whole network gives the tensors of its state_dict") {
  const std::unique_ptr<WeightReader> linear = open_weights(kFolder + "module.pt");  // torch.nn.Linear(2, 1)
  REQUIRE(linear->tensors().size() == 2);
  CHECK(linear->tensors()[0].name == "weight");
  CHECK(linear->tensors()[0].shape == Shape{1, 2});
  CHECK(linear->tensors()[1].name == "bias");

  const auto module = [](const std::string& parameters, const std::string& parts) {
    return global("__main__", "Net") + ")" + op(0x81) + "}" + text("_parameters") + parameters + "s" +
           text("_buffers") + dict("passing", kTensor) + text("mean") + kTensor + "s" + "s" +
           text("_non_persistent_buffers_set") + global("__builtin__", "set") + "](" + text("passing") + "e" +
           op(0x85) + "Rs" + text("_modules") + parts + "sb";
  };
  const std::string inner = module(dict("w", kTensor) + text("bias") + "Ns", "}");
  const TemporaryFolder folder;
  const std::string path = folder.file("x.pt");
  write_text(path, checkpoint_of(pickle(dict("model", module("}", dict("0", inner))))));
  std::vector<std::string> names;
  const std::unique_ptr<WeightReader> whole = open_weights(path);
  for (const TensorInfo& info : whole->tensors()) names.push_back(info.name);
  std::ranges::sort(names);
  CHECK(names == std::vector<std::string>{"0.mean", "0.w", "mean"});

  // A network that is, many times over, its own part: the work is bounded, and ends in an error.
  std::string self = global("__main__", "Net") + ")" + op(0x81) + "q" + op(0) + "}" + text("_parameters") +
                     "}s" + text("_modules") + "}";
  for (int i = 0; i < 10; ++i) self += text(std::to_string(i)) + "h" + op(0) + "s";
  check_refused(self + "sb", "holds no dictionary of tensors, but objects of __main__.Net");
}

TEST_CASE("a TorchScript program is called one") {
  const std::string good = pickle(dict("w", kTensor));
  CHECK(refusal_of(zip_of({{"a/data.pkl", good}, {"a/constants.pkl", good}}))
            .find("this is a TorchScript program (load it in Python with torch.jit.load()") !=
        std::string::npos);
}

TEST_CASE("a call of an allowed function with unexpected arguments is refused") {
  check_refused(text("print") + ")R", "something is called that is not a function");
  check_refused(kOrderedDict + "NR", "something is called that is not a function");
  check_refused(kOrderedDict + tuple({1, 2}) + "R", "OrderedDict is not called as expected");
  check_refused(kOrderedDict + "(](" + tuple({1, 2, 3}) + "etR", "OrderedDict is not called as expected");
  check_refused(global("torch", "FloatStorage") + "(K" + op(9) + "tR", "but objects of torch.FloatStorage");
  check_refused(global("torch._utils", "_rebuild_tensor_v2") + ")R", "is not called as expected");
  check_refused(global("torch._utils", "_rebuild_tensor_v2") + tuple({1, 2, 3, 4, 5, 6}) + "R",
                "a tensor has no storage");
  check_refused(global("torch._utils", "_rebuild_parameter") + tuple({1, 2, 3}) + "R",
                "is not called as expected");
}

TEST_CASE("a tensor must lie within its storage") {
  const auto refused = [](std::int64_t offset, const std::vector<std::int64_t>& sizes,
                          const std::vector<std::int64_t>& strides, const char* message) {
    check_refused(dict("w", tensor(storage("0", 6), offset, sizes, strides)), message);
  };
  CHECK(refusal_of_pickle(dict("w", kTensor)) == "accepted");
  CHECK(refusal_of_pickle(dict("w", tensor(storage("0", 6), 5, {1, 7}, {9, 0}))) == "accepted");
  CHECK(refusal_of_pickle(dict("w", tensor(storage("0", 6), 99, {0, 7}, {7, 1}))) == "accepted");
  constexpr std::int64_t kHuge = std::int64_t{1} << 62;
  refused(0, {7}, {1}, "a tensor reaches past the end of storage 0, which has 6 elements");
  refused(1, {2, 3}, {3, 1}, "reaches past the end");
  refused(6, {}, {}, "reaches past the end");
  refused(kHuge, {1}, {1}, "reaches past the end");
  refused(0, {3}, {kHuge}, "reaches past the end");
  refused(0, {kHuge, 2}, {kHuge, 4}, "reaches past the end");
  refused(0, {2, 3}, {3}, "reaches past the end");
  refused(-1, {1}, {1}, "a tensor's offset is negative: -1");
  refused(0, {-1}, {1}, "a tensor's size is negative: -1");
  refused(5, {2}, {-1}, "a tensor's stride is negative: -1");
  refused(0, {1, 1, 1, 1, 1, 1}, {1, 1, 1, 1, 1, 1}, "more than five dimensions");
  refused(0, {kHuge}, {0}, "tensor w: the product of its dimensions is too large");
  refused(0, {1 << 30, 1 << 30}, {0, 0}, "tensor w: the product of its dimensions is too large");
  refused(0, {1 << 20, 1 << 20}, {0, 0}, "its tensors would take more than");
}

TEST_CASE("a storage must be what it says") {
  const auto refused = [](const std::string& s, const char* message) {
    check_refused(dict("w", tensor(s, 0, {1}, {1})), message);
  };
  refused(storage("0", -1), "a storage's size is negative: -1");
  refused(storage("0", std::int64_t{1} << 61), "a storage's size is too large");
  refused(storage("0", 7), "a/data/0 has 24 bytes, 7 elements of F32 are needed");
  refused(storage("0", 6, "DoubleStorage"), "a/data/0 has 24 bytes, 6 elements of F64 are needed");
  refused(storage("1", 6), "the data of storage 1 is missing");
  refused(storage("../version", 6), "the data of storage ../version is missing");
  refused(storage("0", 6, "QInt8Storage"), "\"torch QInt8Storage\" is no storage class");
  refused(storage("0", 6, "Size"), "\"torch Size\" is no storage class");
  refused(storage(std::string(300, 'k'), 6), "a persistent id is no storage");
  refused(text("storage") + "Q", "a persistent id is no storage");
  refused(tuple({1, 2, 3, 4, 5}) + "Q", "a persistent id is no storage");
  check_refused(dict("w", tensor(storage("0", 6), 0, {1}, {1})) + text("v") +
                    tensor(storage("0", 3, "DoubleStorage"), 0, {1}, {1}) + "s",
                "storage 0 is described in two ways");
}

TEST_CASE("a damaged pickle machine never reads what is not there") {
  check_refused("t", "there is no mark");
  check_refused("u", "there is no mark");
  check_refused("a", "the stack is empty");
  check_refused("(K" + op(1) + "(a", "the stack is empty");
  check_refused("R", "the stack is empty");
  check_refused("q" + op(0), "the stack is empty");
  check_refused("h" + op(0), "memo entry 0 does not exist");
  check_refused("j" + u32(0xFFFFFFFFu), "memo entry 4294967295 does not exist");
  check_refused("", "the pickle ends with 0 objects");
  check_refused("}}", "the pickle ends with 2 objects");
  check_refused("}(", "the pickle ends with 1 objects");
  check_refused("}K" + op(1) + "a", "something is appended that is not a list");
  check_refused("]NNs", "items are set in something that is not a dictionary");
  check_refused("}(Nu", "items are set in something that is not a dictionary");
  check_refused("X" + u32(0xFFFFFFFFu), "the pickle is cut short");
  check_refused(op(0x8d) + u64(~std::uint64_t{0}), "the pickle is cut short");
  check_refused("c" + std::string(100, 'x'), "the pickle is cut short");
  check_refused(op(0x8a) + op(9) + std::string(9, 'x'), "a number does not fit into 64 bits");
  CHECK(refusal_of(checkpoint_of(op(0x80) + op(1) + "}.")).find("pickle protocol 1 is not read") !=
        std::string::npos);
  check_refused("N", "holds no dictionary of tensors");
  check_refused(kTensor, "holds no dictionary of tensors");
  check_refused(dict("w\n", kTensor), "the name of tensor 0 is not a text");
  check_refused(dict("w\xFF", kTensor), "the name of tensor 0 is not a text");
  check_refused(dict("w", kTensor) + text("w") + kTensor + "s", "tensor w comes twice");
}

TEST_CASE("bombs of depth, memo, copies and objects stay small and end in an error") {
  std::string deep(200000, ']');
  for (int i = 1; i < 200000; ++i) deep += "a";
  check_refused(deep, "holds no dictionary of tensors");
  std::string nested;
  for (int i = 0; i < 50000; ++i) nested += "}" + text("a");
  check_refused(nested + "N" + std::string(50000, 's'), "holds no dictionary of tensors");
  check_refused("}q" + op(0) + text("self") + "h" + op(0) + "s", "holds no dictionary of tensors");
  check_refused("]r" + u32(0xFFFFFFFFu) + "j" + u32(0xFFFFFFFFu) + "a", "holds no dictionary of tensors");

  std::string laughs = "]q" + op(0);  // each list holds the one before ten times
  for (int i = 1; i < 30; ++i) {
    laughs += "](";
    for (int k = 0; k < 10; ++k) laughs += "h" + op(i - 1);
    laughs += "eq" + op(i) + "a";
  }
  check_refused(laughs, "holds no dictionary of tensors");

  std::string copies =
      kOrderedDict + "q" + op(0) + "(](";  // one long list, made into a dictionary again and again
  for (int i = 0; i < 10000; ++i) copies += "NN" + op(0x86);
  copies += "etq" + op(1);
  for (int i = 0; i < 1000; ++i) copies += "h" + op(0) + "h" + op(1) + "R";
  check_refused(copies, "OrderedDict is not called as expected");

  check_refused(std::string(2'000'001, 'N'), "more than 2000000 objects");
}

TEST_CASE("old pickles are read: OrderedDict with its items, storages that are views, nested parameters") {
  const TemporaryFolder folder;
  const std::string path = folder.file("x.pt");
  const std::string part = "(" + text("view") + integer(2) + integer(3) + "t";
  const std::string list =
      "]](" + text("w") + tensor(storage("5", 6, "FloatStorage", part), 1, {2}, {1}) + "ea";
  const std::string python2 = pickle(kOrderedDict + "(" + list + "tR");
  const std::vector<float> values = {0, 1, 2, 3, 4, 5};
  const std::string data(reinterpret_cast<const char*>(values.data()), 24);
  write_text(path, stream_of(python2, {{"5", data}}, {6}));
  const std::unique_ptr<WeightReader> reader = open_weights(path);
  REQUIRE(reader->tensors().size() == 1);
  const Tensor w = load(*reader, 0);
  CHECK(w.data<float>()[0] == 3.0F);
  CHECK(w.data<float>()[1] == 4.0F);

  const std::string bad = "(" + text("view") + integer(4) + integer(3) + "t";
  CHECK(refusal_of(stream_of(pickle(dict("w", tensor(storage("5", 6, "FloatStorage", bad), 0, {1}, {1}))),
                             {{"5", data}}, {6}))
            .find("a storage's view reaches past its end") != std::string::npos);
}

TEST_CASE("a stream's list of storages must match its tensors") {
  const std::string body = pickle(dict("w", kTensor));
  const std::string data(24, '\0');
  CHECK(refusal_of(stream_of(body, {{"0", data}}, {6})) == "accepted");
  CHECK(refusal_of(stream_of(body, {{"0", data}}, {7})).find("storage 0 has 7 elements, 6 are needed") !=
        std::string::npos);
  CHECK(refusal_of(stream_of(body, {{"1", data}}, {6})).find("does not match the tensors") !=
        std::string::npos);
  CHECK(refusal_of(stream_of(body, {{"0", data}, {"0", data}}, {6, 6})).find("does not match the tensors") !=
        std::string::npos);
  CHECK(refusal_of(stream_of(body, {}, {})).find("the list of storages is not complete") !=
        std::string::npos);
  CHECK(refusal_of(stream_of(body, {{"0", data + "x"}}, {6})).find("1 bytes after the last storage") !=
        std::string::npos);
}

TEST_CASE("a zip64 archive is read") {
  const TemporaryFolder folder;
  const std::string path = folder.file("x.pt");
  write_text(path,
             zip_of({{"a/data.pkl", pickle(dict("w", kTensor))}, {"a/data/0", std::string(24, 'x')}}, true));
  CHECK(load(*open_weights(path), 0).raw()[23] == std::byte{'x'});
}

TEST_CASE("a zip archive with something unusual is refused by name") {
  const std::string good = pickle(dict("w", kTensor));
  const std::string data(24, '\0');
  const auto with = [&](ZipMember member) {
    return refusal_of(zip_of({{"a/data.pkl", good}, std::move(member)}));
  };
  CHECK(with({"a/data/0", data}) == "accepted");
  CHECK(with({"a/data/0", data, 1}).find("a/data/0 is encrypted") != std::string::npos);
  CHECK(with({"a/data/0", data, 0, 14}).find("compressed by method 14") != std::string::npos);
  CHECK(with({"a/data/0", data, 0, 8}).find("the compressed data of a/data/0 is") != std::string::npos);
  CHECK(with({"a/data/0", data, 0, 0, 23}).find("its two sizes differ") != std::string::npos);
  CHECK(with({"a/data/0", data, 0, 8, 0xFFFFFFF0u}).find("a/data/0 has an impossible size") !=
        std::string::npos);
  CHECK(with({"b/data.pkl", good}).find("the archive holds two checkpoints") != std::string::npos);
  CHECK(with({"a/data.pkl", good}).find("a/data.pkl comes twice") != std::string::npos);
  CHECK(with({"a/\n", data}).find("is not a text") != std::string::npos);
  CHECK(refusal_of(zip_of({{"data.pkl", good}})).find("holds no PyTorch checkpoint") != std::string::npos);
  CHECK(refusal_of(zip_of({{"a/data.pkl", good}, {"a/data/0", data}, {"a/byteorder", "big"}}))
            .find("big-endian") != std::string::npos);
  CHECK(refusal_of(zip_of({{"a/data.pkl", good}, {"a/data/0", data}, {"a/byteorder", "little"}})) ==
        "accepted");
  CHECK(refusal_of("PK\3\4").find("has no end record") != std::string::npos);
}

TEST_CASE("a file that is no weight file at all is refused") {
  CHECK(refusal_of("").find("the file is empty") != std::string::npos);
  CHECK(refusal_of("x").find("cut short") != std::string::npos);
  CHECK(refusal_of("\xFF" + std::string(100, '\x7F')).find("is it a safetensors file?") != std::string::npos);
  CHECK(refusal("/dev/null").find("not a regular file") != std::string::npos);
}
