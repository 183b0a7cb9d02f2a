#include "tests/ops/onnx_node.h"

#include <doctest/doctest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <span>

#include "ops/case_io.h"
#include "ops/check.h"
#include "ops/onnx/onnx_file.h"
#include "runtime/error.h"
#include "tests/temporary_folder.h"

using namespace slide;
using namespace slide::test;

namespace {

void write(const std::string& path, const std::string& content) {
  std::ofstream(path, std::ios::binary) << content;
}

/// A node test in a folder; removed with it.
class NodeTest {
 public:
  NodeTest(const std::string& model, const std::vector<std::string>& inputs, const std::string& output) {
    std::filesystem::create_directory(folder_.file("test_data_set_0"));
    write(folder_.file("model.onnx"), model);
    for (std::size_t i = 0; i < inputs.size(); ++i)
      write(folder_.file("test_data_set_0/input_" + std::to_string(i) + ".pb"), inputs[i]);
    write(folder_.file("test_data_set_0/output_0.pb"), output);
  }
  [[nodiscard]] ops::OperatorCase read() const { return ops::read_case(folder_.path().string()); }
  [[nodiscard]] std::string folder() const { return folder_.path().string(); }
  /// The message with which it is refused.
  [[nodiscard]] std::string refusal() const {
    try {
      const ops::OperatorCase c = read();
      static_cast<void>(ops::check_case(c, Isa::kBaseline));
    } catch (const Error& e) {
      CHECK(e.kind() == ErrorKind::kBadInput);
      return e.what();
    }
    return "taken";
  }

 private:
  TemporaryFolder folder_;
};

bool holds(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

std::span<const std::byte> view(const std::string& bytes) { return std::as_bytes(std::span(bytes)); }

const std::string kImage = onnx_tensor({1, 1, 3, 3}, {1, 2, 3, 4, 5, 6, 7, 8, 9});
const std::string kOnes = onnx_tensor({1, 1, 2, 2}, {1, 1, 1, 1});

}  // namespace

TEST_CASE("a convolution of ONNX's becomes a case that the definition agrees with") {
  const NodeTest test(
      onnx_model("Conv", {"x", "w"}, integers("kernel_shape", {2, 2}) + integers("pads", {0, 0, 1, 1})),
      {kImage, kOnes}, onnx_tensor({1, 1, 3, 3}, {12, 16, 9, 24, 28, 15, 15, 17, 9}));
  const ops::OperatorCase c = test.read();
  CHECK(c.op == "conv2d");
  CHECK(nlohmann::json::parse(c.attributes)["padding"] == nlohmann::json({0, 0, 1, 1}));
  REQUIRE(c.inputs.size() == 2);
  CHECK(c.inputs[1].first == "weight");
  CHECK(ops::check_case(c, Isa::kBaseline).passed());
  CHECK(ops::case_files(test.folder()) == std::vector{test.folder() + "/model.onnx"});
  // The same padding under ONNX's other name; the other side of it gives another result.
  for (const std::string mode : {"SAME_UPPER", "SAME_LOWER"}) {
    const NodeTest same(onnx_model("Conv", {"x", "w"}, text("auto_pad", mode)), {kImage, kOnes},
                        onnx_tensor({1, 1, 3, 3}, {12, 16, 9, 24, 28, 15, 15, 17, 9}));
    CHECK(ops::check_case(same.read(), Isa::kBaseline).passed() == (mode == "SAME_UPPER"));
  }
}

TEST_CASE("inputs left out, constants, defaults and doubles are read as ONNX means them") {
  // Clip without a minimum; the maximum is a constant of the graph, in a list of floats instead of raw bytes.
  const std::string most = number(2, 1) + bytes(8, "most") + bytes(4, little_endian<float>({2.5F}));
  const NodeTest clip(onnx_model("Clip", {"x", "", "most"}, "", bytes(5, most)),
                      {onnx_tensor({3}, {-9, 1, 4})}, onnx_tensor({3}, {-9, 1, 2.5F}));
  CHECK(clip.read().attributes == R"({"max":2.5})");
  CHECK(ops::check_case(clip.read(), Isa::kBaseline).passed());
  // LeakyRelu: 0.01 if nothing is said.
  const NodeTest leaky(onnx_model("LeakyRelu", {"x"}), {onnx_tensor({2}, {-100, 3})},
                       onnx_tensor({2}, {-1, 3}));
  CHECK(ops::check_case(leaky.read(), Isa::kBaseline).passed());
  const NodeTest elu(onnx_model("Elu", {"x"}, real("alpha", 2)), {onnx_tensor({1}, {-200})},
                     onnx_tensor({1}, {-2}));
  CHECK(ops::check_case(elu.read(), Isa::kBaseline).passed());
  // float64, as raw bytes, and as numbers of their own.
  for (const std::string& data :
       {bytes(9, little_endian<double>({0.1, -0.5})), bytes(10, little_endian<double>({0.1, -0.5}))}) {
    const std::string x = packed(1, {2}) + number(2, 11) + data;
    const NodeTest abs(onnx_model("Abs", {"x"}), {x},
                       packed(1, {2}) + number(2, 11) + bytes(9, little_endian<double>({0.1, 0.5})));
    CHECK(abs.read().expected.dtype() == DType::kF64);
    CHECK(ops::check_case(abs.read(), Isa::kBaseline).reference_error == 0);
  }
  // Extents and elements one by one, not packed.
  const std::string loose = number(1, 1) + number(1, 2) + number(2, 7) + number(7, -5) + number(7, 6);
  const ops::OnnxTensor tensor = ops::parse_onnx_tensor(view(loose), "loose");
  CHECK(tensor.values.shape() == Shape{1, 2});
  CHECK(tensor.values.data<std::int64_t>()[0] == -5);
  // Concat counts its axis from the end; a third input of Max is more than the operator has.
  const std::string one = onnx_tensor({1, 1}, {1});
  const NodeTest concat(onnx_model("Concat", {"a", "b"}, integer("axis", -1)), {one, one},
                        onnx_tensor({1, 2}, {1, 1}));
  CHECK(ops::check_case(concat.read(), Isa::kBaseline).passed());
  CHECK(holds(NodeTest(onnx_model("Max", {"a", "b", "c"}), {one, one, one}, one).refusal(), "with 3 inputs"));
}

TEST_CASE("what is no node test that can be read is refused by name") {
  const std::string relu = onnx_model("Relu", {"x"});
  const auto refusal = [&](const std::string& model, const std::string& x) {
    return NodeTest(model, {x}, kOnes).refusal();
  };
  CHECK(holds(refusal(onnx_model("Gemm", {"x"}), kOnes), "model.onnx: Gemm is no operator that SLIDE has"));
  CHECK(holds(refusal(relu + bytes(7, bytes(1, bytes(4, "Relu"))), kOnes), "the model has 2 nodes"));
  CHECK(holds(refusal("", kOnes), "the model has 0 nodes"));
  CHECK(holds(refusal(relu, packed(1, {2, 2}) + number(2, 6)),
              "input_0.pb: a tensor of ONNX's element type 6"));
  CHECK(holds(refusal(relu, onnx_tensor({2, 2}, {1})),
              "input_0.pb: a tensor of 2x2 elements has 4 bytes of data, not 16"));
  CHECK(holds(refusal(relu, onnx_tensor({-1, 2}, {1, 2})), "negative or too large"));
  const std::int64_t huge = std::int64_t{1} << 39U;
  CHECK(holds(refusal(relu, onnx_tensor({huge, huge}, {1})), "negative or too large"));
  CHECK(holds(refusal(relu, onnx_tensor({1, 1, 1, 1, 1, 1}, {1})), "more than five axes"));
  CHECK(holds(refusal(relu, std::string(11, '\xff')), "a number has more than ten bytes"));
  CHECK(holds(refusal(relu, "\x0f"), "field 1 has an unknown type"));
  CHECK(holds(refusal(onnx_model("Conv", {"x", "w"}, integers("pads", {1})), kImage),
              "input_1.pb: cannot read"));
  CHECK(
      holds(NodeTest(onnx_model("Conv", {"x", "w"}, integers("pads", {1})), {kImage, kOnes}, kOnes).refusal(),
            "Conv has 1 numbers as attribute pads"));
  CHECK(
      holds(NodeTest(onnx_model("MaxPool", {"x"}, text("auto_pad", "SAME_UPPER")), {kImage}, kOnes).refusal(),
            "that is none"));
  CHECK(refusal(relu, kOnes) == "taken");
}

TEST_CASE("a node test that is cut short or has a flipped bit is an error or another case, never more") {
  const std::string model =
      onnx_model("Conv", {"x", "w"}, integers("strides", {1, 2}) + text("auto_pad", "VALID"));
  const auto survives = [](const std::string& m, const std::string& x) {
    try {
      static_cast<void>(ops::parse_onnx_node(view(m), "m"));
      static_cast<void>(ops::parse_onnx_tensor(view(x), "x"));
    } catch (const Error& e) {
      return e.kind() == ErrorKind::kBadInput;
    }
    return true;
  };
  int refused = 0;
  for (std::size_t length = 0; length < model.size(); ++length)
    CHECK(survives(model.substr(0, length), kImage));
  for (std::size_t length = 0; length < kImage.size(); ++length) {
    CHECK(survives(model, kImage.substr(0, length)));
    try {
      static_cast<void>(ops::parse_onnx_tensor(view(kImage.substr(0, length)), "x"));
    } catch (const Error&) {
      ++refused;
    }
  }
  CHECK(refused == static_cast<int>(kImage.size()));  // no part of a tensor is one
  for (std::size_t bit = 0; bit < 8 * model.size(); ++bit) {
    std::string flipped = model;
    flipped[bit / 8] = static_cast<char>(flipped[bit / 8] ^ (1 << bit % 8));
    CHECK(survives(flipped, kImage));
  }
  for (std::size_t bit = 0; bit < 8 * kImage.size(); ++bit) {
    std::string flipped = kImage;
    flipped[bit / 8] = static_cast<char>(flipped[bit / 8] ^ (1 << bit % 8));
    CHECK(survives(model, flipped));
  }
}
