#include "ops/onnx/onnx_case.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "ops/onnx/onnx_file.h"
#include "runtime/error.h"

namespace slide::ops {
namespace {

using Json = nlohmann::ordered_json;
using Pair = std::array<std::int64_t, 2>;

/// A node with the tensors that it is given; builds the case.
class Call {
 public:
  Call(OnnxNode node, std::vector<std::optional<Tensor>> inputs, Tensor output, std::string file)
      : node_(std::move(node)),
        inputs_(std::move(inputs)),
        output_(std::move(output)),
        file_(std::move(file)) {}

  [[nodiscard]] const std::string& op() const { return node_.op; }
  [[nodiscard]] const Tensor& output() const { return output_; }
  [[noreturn]] void fail(const std::string& problem) const {
    throw Error(ErrorKind::kBadInput, file_ + ": " + node_.op + " " + problem,
                "docs/slide_check.md lists what is read");
  }

  [[nodiscard]] bool has(std::size_t i) const { return i < inputs_.size() && inputs_[i]; }
  [[nodiscard]] const Tensor& input(std::size_t i) const {
    if (!has(i)) fail("has no input " + std::to_string(i));
    return *inputs_[i];
  }
  [[nodiscard]] std::size_t count() const { return inputs_.size(); }
  /// An input that is one number.
  [[nodiscard]] double number_input(std::size_t i) const {
    if (input(i).count() != 1) fail("has an input " + std::to_string(i) + " that is not one number");
    return input(i).to(DType::kF64).data<double>()[0];
  }

  [[nodiscard]] bool says(std::string_view name) const { return node_.attributes.contains(name); }
  [[nodiscard]] double number(std::string_view name, double otherwise) const {
    return says(name) ? find(name).number : otherwise;
  }
  [[nodiscard]] std::int64_t integer(std::string_view name, std::int64_t otherwise) const {
    return says(name) ? find(name).integer : otherwise;
  }
  [[nodiscard]] std::string text(std::string_view name, const std::string& otherwise) const {
    return says(name) ? find(name).text : otherwise;
  }
  template <std::size_t N>
  [[nodiscard]] std::array<std::int64_t, N> integers(std::string_view name,
                                                     std::array<std::int64_t, N> otherwise) const {
    if (!says(name)) return otherwise;
    const std::vector<std::int64_t>& list = find(name).integers;
    if (list.size() != N)
      fail("has " + std::to_string(list.size()) + " numbers as attribute " + std::string(name));
    std::copy_n(list.begin(), N, otherwise.begin());
    return otherwise;
  }
  /// x, which must be an image.
  [[nodiscard]] const Shape& image() const {
    if (input(0).shape().rank() != 4) fail("of " + input(0).shape().text() + " is no operator on images");
    return input(0).shape();
  }

  [[nodiscard]] OperatorCase made(const std::string& op, const Json& attributes,
                                  const std::vector<std::string>& names) const {
    OperatorCase c;
    c.op = op;
    c.attributes = attributes.dump();
    c.source = "ONNX node test " + file_;
    for (std::size_t i = 0; i < inputs_.size() && i < names.size(); ++i)
      if (has(i)) c.inputs.emplace_back(names[i], input(i));
    c.expected = output_;
    return c;
  }

 private:
  [[nodiscard]] const OnnxAttribute& find(std::string_view name) const {
    return node_.attributes.find(name)->second;
  }
  OnnxNode node_;
  std::vector<std::optional<Tensor>> inputs_;
  Tensor output_;
  std::string file_;
};

/// Top, left, bottom, right of a window, by ONNX's auto_pad or as given.
std::array<std::int64_t, 4> padding(const Call& call, const Pair& kernel, const Pair& stride,
                                    const Pair& dilation) {
  const std::string mode = call.text("auto_pad", "NOTSET");
  if (mode == "NOTSET") return call.integers<4>("pads", {0, 0, 0, 0});
  if (mode == "VALID") return {0, 0, 0, 0};
  if (mode != "SAME_UPPER" && mode != "SAME_LOWER") call.fail("has an unknown auto_pad");
  const Shape& x = call.image();
  std::array<std::int64_t, 4> result{};
  constexpr std::int64_t kMost = 1 << 24;
  for (std::size_t i = 0; i < 2; ++i) {
    for (const std::int64_t v : {kernel[i], stride[i], dilation[i]})
      if (v < 1 || v > kMost) call.fail("has a window, stride or dilation that is none");
    const std::int64_t extent = x[2 + static_cast<int>(i)];
    const std::int64_t last = (extent + stride[i] - 1) / stride[i] - 1;
    const std::int64_t all =
        std::max<std::int64_t>(0, last * stride[i] + (kernel[i] - 1) * dilation[i] + 1 - extent);
    result[i] = mode == "SAME_UPPER" ? all / 2 : all - all / 2;
    result[i + 2] = all - result[i];
  }
  return result;
}

OperatorCase convolution(const Call& call) {
  static_cast<void>(call.image());
  const Shape& weight = call.input(1).shape();
  if (weight.rank() != 4) call.fail("has weights that are not of two dimensions");
  const Pair stride = call.integers<2>("strides", {1, 1});
  const Pair dilation = call.integers<2>("dilations", {1, 1});
  return call.made("conv2d",
                   {{"stride", stride},
                    {"padding", padding(call, {weight[2], weight[3]}, stride, dilation)},
                    {"dilation", dilation},
                    {"groups", call.integer("group", 1)}},
                   {"x", "weight", "bias"});
}

OperatorCase pool(const Call& call, bool average) {
  static_cast<void>(call.image());
  const Pair kernel = call.integers<2>("kernel_shape", {0, 0});
  const Pair stride = call.integers<2>("strides", {1, 1});
  if (call.integers<2>("dilations", {1, 1}) != Pair{1, 1}) call.fail("is dilated");
  Json json{{"kernel", kernel},
            {"stride", stride},
            {"padding", padding(call, kernel, stride, {1, 1})},
            {"ceil_mode", call.integer("ceil_mode", 0) != 0}};
  if (average) json["count_include_pad"] = call.integer("count_include_pad", 0) != 0;
  return call.made(average ? "avg_pool2d" : "max_pool2d", json, {"x"});
}

OperatorCase resize(const Call& call) {
  const Shape& x = call.image();
  const Shape& y = call.output().shape();
  if (y.rank() != 4 || y[0] != x[0] || y[1] != x[1]) call.fail("resizes more than height and width");
  for (const char* name : {"exclude_outside", "antialias"})
    if (call.integer(name, 0) != 0) call.fail("has an attribute " + std::string(name));
  for (const char* name : {"axes", "keep_aspect_ratio_policy"})
    if (call.says(name)) call.fail("has an attribute " + std::string(name));
  Json json{{"mode", call.text("mode", "nearest")},
            {"coordinates", call.text("coordinate_transformation_mode", "half_pixel")},
            {"size", {y[2], y[3]}}};
  if (call.has(2) && call.input(2).count() == 4) {
    const Tensor scales = call.input(2).to(DType::kF64);
    json["scale"] = {scales.data<double>()[2], scales.data<double>()[3]};
  }
  if (json["mode"] == "nearest") json["nearest"] = call.text("nearest_mode", "round_prefer_floor");
  if (json["mode"] == "cubic") json["cubic_a"] = call.number("cubic_coeff_a", -0.75);
  return call.made("resize", json, {"x"});
}

OperatorCase pad(const Call& call) {
  static_cast<void>(call.image());
  const Tensor& pads = call.input(1);
  if (pads.dtype() != DType::kI64 || pads.count() != 8) call.fail("has no list of eight paddings");
  const std::span<const std::int64_t> p = pads.data<std::int64_t>();
  if (p[0] != 0 || p[1] != 0 || p[4] != 0 || p[5] != 0 || call.count() > 3)
    call.fail("pads more than height and width");
  return call.made("pad",
                   {{"padding", {p[2], p[3], p[6], p[7]}},
                    {"mode", call.text("mode", "constant")},
                    {"value", call.has(2) ? call.number_input(2) : 0.0}},
                   {"x"});
}

OperatorCase batch_norm(const Call& call) {
  if (call.integer("training_mode", 0) != 0) call.fail("trains");
  return call.made("batch_norm", {{"eps", call.number("epsilon", 1e-5F)}},
                   {"x", "weight", "bias", "running_mean", "running_var"});
}

OperatorCase clip(const Call& call) {
  Json json = Json::object();
  if (call.has(1)) json["min"] = call.number_input(1);
  if (call.has(2)) json["max"] = call.number_input(2);
  return call.made("clip", json, {"x"});
}

OperatorCase concat(const Call& call) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < call.count(); ++i) names.push_back("x" + std::to_string(i));
  return call.made("concat", {{"axis", call.integer("axis", 0)}}, names);
}

struct Alike {
  std::string_view onnx, ours;
};
constexpr Alike kUnary[] = {{"Relu", "relu"}, {"Sigmoid", "sigmoid"}, {"Tanh", "tanh"},
                            {"Exp", "exp"},   {"Sqrt", "sqrt"},       {"Abs", "abs"}};
constexpr Alike kBinary[] = {{"Add", "add"}, {"Sub", "sub"},     {"Mul", "mul"},
                             {"Div", "div"}, {"Max", "maximum"}, {"Min", "minimum"}};

OperatorCase case_of(const Call& call) {
  const std::string& op = call.op();
  for (const Alike& a : kUnary)
    if (op == a.onnx) return call.made(std::string(a.ours), Json::object(), {"x"});
  for (const Alike& a : kBinary)
    if (op == a.onnx && call.count() == 2)
      return call.made(std::string(a.ours), Json::object(), {"x", "other"});
  if (op == "Conv") return convolution(call);
  if (op == "MaxPool" || op == "AveragePool") return pool(call, op == "AveragePool");
  if (op == "GlobalAveragePool") return call.made("global_avg_pool2d", Json::object(), {"x"});
  if (op == "Resize") return resize(call);
  if (op == "Elu") return call.made("elu", {{"alpha", call.number("alpha", 1)}}, {"x"});
  if (op == "LeakyRelu") return call.made("leaky_relu", {{"slope", call.number("alpha", 0.01F)}}, {"x"});
  if (op == "Clip") return clip(call);
  if (op == "Softmax") return call.made("softmax", {{"axis", call.integer("axis", -1)}}, {"x"});
  if (op == "Concat") return concat(call);
  if (op == "BatchNormalization") return batch_norm(call);
  if (op == "Pad") return pad(call);
  call.fail("is no operator that SLIDE has, or not with " + std::to_string(call.count()) + " inputs");
}

}  // namespace

OperatorCase read_onnx_case(const std::string& model) {
  OnnxNode node = parse_onnx_node(read_small_file(model), model);
  const std::filesystem::path data = std::filesystem::path(model).parent_path() / "test_data_set_0";
  const auto tensor = [&](const std::string& name) {
    const std::string path = (data / name).string();
    return parse_onnx_tensor(read_small_file(path), path).values;
  };
  std::vector<std::optional<Tensor>> inputs;
  int files = 0;
  for (const std::string& name : node.inputs) {
    const auto constant = std::ranges::find(node.constants, name, &OnnxTensor::name);
    if (name.empty())
      inputs.emplace_back();
    else if (constant != node.constants.end())
      inputs.emplace_back(constant->values);
    else
      inputs.emplace_back(tensor("input_" + std::to_string(files++) + ".pb"));
  }
  const Tensor output = tensor("output_0.pb");
  if (output.dtype() == DType::kI64)
    throw Error(ErrorKind::kBadInput, model + ": the result is not of floating-point numbers");
  return case_of(Call(std::move(node), std::move(inputs), output, model));
}

}  // namespace slide::ops
