#include "ops/webnn/webnn_case.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <vector>

#include "ops/onnx/onnx_file.h"
#include "runtime/error.h"

namespace slide::ops {
namespace {

using Json = nlohmann::ordered_json;
using Pair = std::array<std::int64_t, 2>;
using Axes = std::array<int, 4>;

constexpr std::int64_t kMost = std::int64_t{1} << 24;  // of an extent, and of a tensor's elements
constexpr int kDeepest = 32;                           // of brackets in brackets

/// A file's JSON; discarded if it is none, or nested deeper than any test is.
Json parse(std::span<const std::byte> bytes) {
  const auto* text = static_cast<const char*>(static_cast<const void*>(bytes.data()));
  bool deep = false;
  const auto shallow = [&](int depth, Json::parse_event_t, Json&) {
    deep = deep || depth > kDeepest;
    return !deep;
  };
  Json json = Json::parse(text, text + bytes.size(), shallow, false, true);
  return deep ? Json(Json::value_t::discarded) : json;
}

const Json* tests_of(const Json& json) {
  if (!json.is_object()) return nullptr;
  const auto tests = json.find("tests");
  return tests != json.end() && tests->is_array() ? &*tests : nullptr;
}

/// The axes of an image or a filter in another order.
Tensor permuted(const Tensor& t, const Axes& axes) {
  const Shape& s = t.shape();
  Tensor result(DType::kF32, {s[axes[0]], s[axes[1]], s[axes[2]], s[axes[3]]});
  std::array<std::int64_t, 4> strides{};
  for (int a = 0; a < 4; ++a) {
    std::int64_t stride = 1;
    for (int b = axes[static_cast<std::size_t>(a)] + 1; b < 4; ++b) stride *= s[b];
    strides[static_cast<std::size_t>(a)] = stride;
  }
  const float* from = t.data<float>().data();
  float* to = result.mutable_data<float>().data();
  const Shape& r = result.shape();
  for (std::int64_t i = 0; i < r[0]; ++i)
    for (std::int64_t j = 0; j < r[1]; ++j)
      for (std::int64_t k = 0; k < r[2]; ++k)
        for (std::int64_t l = 0; l < r[3]; ++l)
          *to++ = from[i * strides[0] + j * strides[1] + k * strides[2] + l * strides[3]];
  return result;
}

constexpr Axes kFromNhwc = {0, 3, 1, 2};

/// One test, whose members are asked for by name; builds the case.
class Test {
 public:
  Test(const Json& json, std::string op, std::string place)
      : json_(json), op_(std::move(op)), place_(std::move(place)) {
    if (!json.is_object()) fail("is no object");
    expected_ = tensor(member(json, "expected"), "expected");
  }

  [[nodiscard]] const std::string& op() const { return op_; }
  [[nodiscard]] const Shape& output() const { return expected_.shape(); }
  [[noreturn]] void fail(const std::string& problem) const {
    throw Error(ErrorKind::kBadInput, place_ + " of " + op_ + " " + problem,
                "docs/slide_check.md lists what is read");
  }

  /// Takes input `index` in the file's order, under the name that the operator has for it.
  Tensor& take(std::size_t index, const std::string& name) {
    const Json& inputs = member(json_, "inputs");
    if (!(inputs.is_object() || inputs.is_array()) || index >= inputs.size())
      fail("has no input " + std::to_string(index + 1));
    const Json& input = inputs.is_array()
                            ? inputs[index]
                            : std::next(inputs.begin(), static_cast<std::ptrdiff_t>(index)).value();
    inputs_.emplace_back(name, tensor(input, name));
    return inputs_.back().second;
  }
  [[nodiscard]] std::size_t count() const {
    const Json& inputs = member(json_, "inputs");
    return inputs.is_object() || inputs.is_array() ? inputs.size() : 0;
  }
  /// Takes an operand among the options, if it is there.
  bool take_option(const std::string& option, const std::string& name) {
    const Json* value = find(option);
    if (value != nullptr) inputs_.emplace_back(name, tensor(*value, option));
    return value != nullptr;
  }
  void give(const std::string& name, Tensor value) { inputs_.emplace_back(name, std::move(value)); }

  [[nodiscard]] bool says(const std::string& name) const { return find(name) != nullptr; }
  [[nodiscard]] double number(const std::string& name, double otherwise) const {
    const Json* value = find(name);
    if (value == nullptr) return otherwise;
    if (!value->is_number()) fail("has a " + name + " that is no number");
    return value->get<double>();
  }
  [[nodiscard]] std::string text(const std::string& name, const std::string& otherwise) const {
    const Json* value = find(name);
    if (value == nullptr) return otherwise;
    if (!value->is_string()) fail("has a " + name + " that is no text");
    return value->get<std::string>();
  }
  /// A list of whole numbers among the options, or beside them.
  [[nodiscard]] std::vector<std::int64_t> integers(const std::string& name,
                                                   const std::vector<std::int64_t>& otherwise) const {
    const Json* value = find(name);
    return value == nullptr ? otherwise : list(*value, name);
  }
  template <std::size_t N>
  [[nodiscard]] std::array<std::int64_t, N> array(const std::string& name,
                                                  std::array<std::int64_t, N> otherwise) const {
    const Json* value = find(name);
    if (value == nullptr) return otherwise;
    const std::vector<std::int64_t> numbers = list(*value, name);
    if (numbers.size() != N) fail("has " + std::to_string(numbers.size()) + " numbers as " + name);
    std::copy_n(numbers.begin(), N, otherwise.begin());
    return otherwise;
  }

  /// The first input that was taken.
  [[nodiscard]] const Shape& image() const { return inputs_.front().second.shape(); }
  /// Images in nhwc become nchw, the first input and the result.
  void permute_images(const std::string& layout) {
    if (layout != "nhwc" && layout != "nchw") fail("has an unknown layout");
    for (Tensor* t : {&inputs_.front().second, &expected_}) {
      if (t->shape().rank() != 4) fail("of " + t->shape().text() + " is no operator on images");
      if (layout == "nhwc") *t = permuted(*t, kFromNhwc);
    }
  }

  [[nodiscard]] OperatorCase made(const std::string& op, const Json& attributes) && {
    return {.op = op,
            .attributes = attributes.dump(),
            .source = "WebNN test " + place_,
            .inputs = std::move(inputs_),
            .expected = std::move(expected_)};
  }

 private:
  [[nodiscard]] const Json& member(const Json& object, const char* name) const {
    const auto it = object.is_object() ? object.find(name) : object.end();
    if (it == object.end()) fail(std::string("has no ") + name);
    return *it;
  }
  /// An option; some tests have them beside "options".
  [[nodiscard]] const Json* find(const std::string& name) const {
    if (const auto options = json_.find("options"); options != json_.end() && options->is_object())
      if (const auto it = options->find(name); it != options->end()) return &*it;
    const auto it = json_.find(name);
    return it == json_.end() ? nullptr : &*it;
  }
  [[nodiscard]] std::vector<std::int64_t> list(const Json& value, const std::string& name) const {
    std::vector<std::int64_t> result;
    for (const Json& v : value.is_array() ? value : Json::array({value})) {
      const double number = v.is_number() ? v.get<double>() : NAN;
      if (!(std::fabs(number) <= static_cast<double>(kMost)) || number != std::trunc(number))
        fail("has a " + name + " that is no list of whole numbers");
      result.push_back(static_cast<std::int64_t>(number));
    }
    return result;
  }
  [[nodiscard]] Tensor tensor(const Json& value, const std::string& name) const {
    if (const Json& type = member(value, "type"); type != "float32")
      fail("has a " + name + " that is not of type float32");
    std::vector<std::int64_t> extents = list(member(value, "shape"), name + "'s shape");
    if (extents.size() > static_cast<std::size_t>(Shape::kMaxRank))
      fail("has a " + name + " of too many axes");
    std::int64_t count = 1;
    for (const std::int64_t extent : extents) {
      if (extent < 1) fail("has a " + name + " without elements");
      count = std::min(kMost + 1, count * extent);
    }
    const Json& data = member(value, "data");
    const Json values = data.is_array() ? data : Json::array({data});
    if (count > kMost || static_cast<std::size_t>(count) != values.size())
      fail("has a " + name + " whose data do not fit its shape");
    Tensor result(DType::kF32, Shape(std::span<const std::int64_t>(extents)));
    float* to = result.mutable_data<float>().data();
    for (const Json& v : values) {
      if (!v.is_number()) fail("has a " + name + " that holds something that is no number");
      *to++ = static_cast<float>(v.get<double>());
    }
    return result;
  }

  const Json& json_;
  std::string op_, place_;
  Tensor expected_;
  std::vector<std::pair<std::string, Tensor>> inputs_;
};

/// Top, left, bottom, right of a window, by autoPad or as given (top, bottom, left, right).
std::array<std::int64_t, 4> padding(const Test& test, const Shape& x, const Pair& window, const Pair& stride,
                                    const Pair& dilation) {
  const std::string mode = test.text("autoPad", "explicit");
  const auto given = test.array<4>("padding", {0, 0, 0, 0});
  if (mode == "explicit") return {given[0], given[2], given[1], given[3]};
  if (mode != "same-upper" && mode != "same-lower") test.fail("has an unknown autoPad");
  std::array<std::int64_t, 4> result{};
  for (std::size_t i = 0; i < 2; ++i) {
    for (const std::int64_t v : {window[i], stride[i], dilation[i]})
      if (v < 1) test.fail("has a window, stride or dilation that is none");
    const std::int64_t extent = x[2 + static_cast<int>(i)];
    const std::int64_t last = (extent + stride[i] - 1) / stride[i] - 1;
    const std::int64_t all =
        std::max<std::int64_t>(0, last * stride[i] + (window[i] - 1) * dilation[i] + 1 - extent);
    result[i] = mode == "same-upper" ? all / 2 : all - all / 2;
    result[i + 2] = all - result[i];
  }
  return result;
}

/// Brings a filter into the order output, input, height, width.
Tensor filter_of(const Test& test, const Tensor& filter) {
  struct Layout {
    std::string_view name;
    Axes axes;
  };
  constexpr Layout kLayouts[] = {
      {"oihw", {0, 1, 2, 3}}, {"hwio", {3, 2, 0, 1}}, {"ohwi", {0, 3, 1, 2}}, {"ihwo", {3, 0, 1, 2}}};
  if (filter.shape().rank() != 4) test.fail("has a filter that is not of four axes");
  const std::string name = test.text("filterLayout", "oihw");
  for (const Layout& layout : kLayouts)
    if (name == layout.name) return permuted(filter, layout.axes);
  test.fail("has an unknown filterLayout");
}

OperatorCase convolution(Test test) {
  test.take(0, "x");
  test.permute_images(test.text("inputLayout", "nchw"));
  Tensor& weight = test.take(1, "weight");
  weight = filter_of(test, weight);
  const Shape window = weight.shape();
  test.take_option("bias", "bias");
  const Pair stride = test.array<2>("strides", {1, 1});
  const Pair dilation = test.array<2>("dilations", {1, 1});
  const Json attributes{{"stride", stride},
                        {"padding", padding(test, test.image(), {window[2], window[3]}, stride, dilation)},
                        {"dilation", dilation},
                        {"groups", test.array<1>("groups", {1})[0]}};
  return std::move(test).made("conv2d", attributes);
}

OperatorCase pool(Test test) {
  test.take(0, "x");
  test.permute_images(test.text("layout", "nchw"));
  const Shape x = test.image();
  const Pair window = test.array<2>("windowDimensions", {x[2], x[3]});
  const Pair stride = test.array<2>("strides", {1, 1});
  if (test.array<2>("dilations", {1, 1}) != Pair{1, 1}) test.fail("is dilated");
  const std::string rounding = test.text("roundingType", "floor");
  if ((rounding != "floor" && rounding != "ceil") || test.says("outputSizes"))
    test.fail("has an unknown rounding of its size");
  const Json attributes{{"kernel", window},
                        {"stride", stride},
                        {"padding", padding(test, x, window, stride, {1, 1})},
                        {"ceil_mode", rounding == "ceil"}};
  const std::string op = test.op() == "max_pool2d" ? "max_pool2d" : "avg_pool2d";
  return std::move(test).made(op, attributes);
}

OperatorCase resample(Test test) {
  const Pair axes = test.array<2>("axes", {2, 3});
  test.take(0, "x");
  if (axes != Pair{2, 3} && axes != Pair{1, 2}) test.fail("resizes more than height and width");
  test.permute_images(axes[0] == 1 ? "nhwc" : "nchw");
  const std::string mode = test.text("mode", "nearest-neighbor");
  if (mode != "nearest-neighbor" && mode != "linear") test.fail("has an unknown mode");
  const Shape& y = test.output();
  Json attributes{{"mode", mode == "linear" ? "linear" : "nearest"},
                  {"coordinates", "half_pixel"},
                  {"size", {y[2], y[3]}}};
  if (mode != "linear") attributes["nearest"] = "round_prefer_floor";
  return std::move(test).made("resize", attributes);
}

OperatorCase pad(Test test) {
  const Shape x = test.take(0, "x").shape();
  const auto begin = test.array<4>("beginningPadding", {0, 0, 0, 0});
  const auto end = test.array<4>("endingPadding", {0, 0, 0, 0});
  if (x.rank() != 4 || begin[0] != 0 || begin[1] != 0 || end[0] != 0 || end[1] != 0)
    test.fail("pads more than the height and width of images");
  const std::string mode = test.text("mode", "constant");
  const Json attributes{{"padding", {begin[2], begin[3], end[2], end[3]}},
                        {"mode", mode == "reflection" ? "reflect" : mode},
                        {"value", test.number("value", 0)}};
  return std::move(test).made("pad", attributes);
}

OperatorCase batch_norm(Test test) {
  const Shape x = test.take(0, "x").shape();
  if (x.rank() < 2 || test.array<1>("axis", {1})[0] != 1)
    test.fail("normalises another axis than the second");
  const auto otherwise = [&](const char* option, const char* name, float value) {
    if (test.take_option(option, name)) return;
    Tensor t(DType::kF32, {x[1]});
    std::ranges::fill(t.mutable_data<float>(), value);
    test.give(name, std::move(t));
  };
  otherwise("scale", "weight", 1);
  otherwise("bias", "bias", 0);
  test.take(1, "running_mean");
  test.take(2, "running_var");
  const Json attributes{{"eps", test.number("epsilon", 1e-5)}};
  return std::move(test).made("batch_norm", attributes);
}

OperatorCase concat(Test test) {
  for (std::size_t i = 0; i < test.count(); ++i) test.take(i, "x" + std::to_string(i));
  const Json attributes{{"axis", test.array<1>("axis", {0})[0]}};
  return std::move(test).made("concat", attributes);
}

OperatorCase reduce(Test test) {
  const Shape x = test.take(0, "x").shape();
  if (const std::vector<std::int64_t> axes = test.integers("axes", {}); test.output().rank() == x.rank()) {
    Json all = Json::array();
    for (int a = 0; a < x.rank(); ++a)
      if (axes.empty() || std::ranges::find(axes, a) != axes.end()) all.push_back(a);
    const std::string op = test.op();
    return std::move(test).made(op, {{"axes", all}});
  }
  test.fail("drops the axes that it reduces");
}

OperatorCase of_one(Test test, const std::string& op, const Json& attributes = Json::object()) {
  test.take(0, "x");
  return std::move(test).made(op, attributes);
}

struct Alike {
  std::string_view webnn, ours;
};
constexpr Alike kUnary[] = {{"abs", "abs"},         {"exp", "exp"},   {"sqrt", "sqrt"}, {"relu", "relu"},
                            {"sigmoid", "sigmoid"}, {"tanh", "tanh"}, {"gelu", "gelu"}};
constexpr Alike kBinary[] = {{"add", "add"}, {"sub", "sub"},     {"mul", "mul"},
                             {"div", "div"}, {"max", "maximum"}, {"min", "minimum"}};

OperatorCase case_of(Test test) {
  const std::string op = test.op();
  for (const Alike& a : kUnary)
    if (op == a.webnn) return of_one(std::move(test), std::string(a.ours));
  for (const Alike& a : kBinary)
    if (op == a.webnn) {
      test.take(0, "x");
      test.take(1, "other");
      return std::move(test).made(std::string(a.ours), Json::object());
    }
  if (op == "conv2d") return convolution(std::move(test));
  if (op == "average_pool2d" || op == "max_pool2d") return pool(std::move(test));
  if (op == "resample2d") return resample(std::move(test));
  if (op == "batch_normalization") return batch_norm(std::move(test));
  if (op == "concat") return concat(std::move(test));
  if (op == "pad") return pad(std::move(test));
  if (op.starts_with("reduce_m")) return reduce(std::move(test));
  if (op == "elu") return of_one(test, op, {{"alpha", test.number("alpha", 1)}});
  if (op == "leaky_relu") return of_one(test, op, {{"slope", test.number("alpha", 0.01)}});
  if (op == "linear")
    return of_one(test, "affine", {{"scale", test.number("alpha", 1)}, {"shift", test.number("beta", 0)}});
  if (op == "softmax") return of_one(test, op, {{"axis", test.array<1>("axis", {1})[0]}});
  if (op == "clamp") {
    Json attributes = Json::object();
    if (test.says("minValue")) attributes["min"] = test.number("minValue", 0);
    if (test.says("maxValue")) attributes["max"] = test.number("maxValue", 0);
    return of_one(test, "clip", attributes);
  }
  test.fail("is no test of an operator that SLIDE has");
}

}  // namespace

std::optional<std::size_t> webnn_tests(const std::string& file) {
  const Json json = parse(read_small_file(file));
  const Json* tests = tests_of(json);
  if (tests == nullptr) return std::nullopt;
  return tests->size();
}

OperatorCase parse_webnn_case(std::span<const std::byte> bytes, std::string_view op, std::size_t index,
                              const std::string& file) {
  const Json json = parse(bytes);
  const Json* tests = tests_of(json);
  if (tests == nullptr)
    throw Error(ErrorKind::kBadInput, file + ": not a file of WebNN tests: there is no list \"tests\"");
  if (index < 1 || index > tests->size())
    throw Error(ErrorKind::kBadInput, file + ": there is no test " + std::to_string(index) +
                                          ", the file holds " + std::to_string(tests->size()));
  const Json& test = (*tests)[index - 1];
  std::string place = file + ": test " + std::to_string(index);
  if (test.is_object())
    if (const auto name = test.find("name"); name != test.end() && name->is_string())
      place += " (" + name->get<std::string>().substr(0, 120) + ")";
  return case_of(Test(test, std::string(op), place));
}

OperatorCase read_webnn_case(const std::string& file, std::size_t index) {
  return parse_webnn_case(read_small_file(file), std::filesystem::path(file).stem().string(), index, file);
}

}  // namespace slide::ops
