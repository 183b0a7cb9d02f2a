#include "ops/case_io.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <set>

#include "ops/case_file.h"
#include "ops/case_of.h"
#include "runtime/error.h"
#include "runtime/safetensors_writer.h"
#include "tests/temporary_folder.h"

using namespace slide;
using ops::OperatorCase;

namespace {

/// Positive numbers that are neither equal nor sorted.
Tensor some(const Shape& shape, double start = 0.1) {
  Tensor t(DType::kF64, shape);
  double v = start;
  for (double& e : t.mutable_data<double>()) e = v = std::fmod(v + 0.381966, 1.0) + 0.01;
  return t;
}

/// An operator with attributes that are none of their defaults, and the shapes of its inputs.
struct Call {
  std::string op;
  std::string attributes;
  std::vector<std::pair<std::string, Shape>> inputs;
};

const char* const kConv = R"({"stride":[2,1],"padding":[1,0,2,3],"dilation":[1,2],"groups":2})";
const std::pair<std::string, Shape> kImage{"x", {1, 4, 9, 8}};

std::vector<Call> calls() {
  std::vector<Call> all = {
      {"conv2d", kConv, {kImage, {"weight", {6, 2, 3, 2}}, {"bias", {6}}}},
      {"conv2d", kConv, {kImage, {"weight", {6, 2, 3, 2}}}},
      {"gated_conv2d", kConv, {kImage, {"weight", {8, 2, 3, 2}}, {"bias", {8}}}},
      {"contextual_attention",
       R"({"patch":3,"rate":2,"softmax_scale":4.5,"fuse":3})",
       {{"foreground", {1, 2, 8, 12}}, {"background", {1, 2, 8, 12}}, {"mask", {1, 1, 16, 24}}}},
      {"contextual_attention",
       R"({"fuse":3})",
       {{"foreground", {1, 2, 8, 8}},
        {"background", {1, 2, 8, 8}},
        {"mask", {1, 1, 8, 8}},
        {"fuse_weight", {1, 1, 3, 3}}}},
      {"max_pool2d", R"({"kernel":[3,2],"stride":[2,3],"padding":[1,0,1,1],"ceil_mode":true})", {kImage}},
      {"avg_pool2d",
       R"({"kernel":[3,2],"stride":[2,3],"padding":[1,0,1,1],"count_include_pad":true})",
       {kImage}},
      {"global_avg_pool2d", "{}", {kImage}},
      {"adaptive_avg_pool2d", R"({"size":[3,5]})", {kImage}},
      {"resize",
       R"({"mode":"cubic","coordinates":"asymmetric","size":[4,11],"cubic_a":-0.5,"scale":[0.5,1.3]})",
       {kImage}},
      {"resize",
       R"({"mode":"nearest","coordinates":"align_corners","size":[4,11],"nearest":"round_prefer_ceil"})",
       {kImage}},
      {"resize", R"({"mode":"linear","coordinates":"pytorch_half_pixel","size":[1,11]})", {kImage}},
      {"upsample_nearest", R"({"factor":3})", {kImage}},
      {"leaky_relu", R"({"slope":0.1})", {kImage}},
      {"elu", R"({"alpha":0.7})", {kImage}},
      {"clip", R"({"min":0.2,"max":0.6000000000000001})", {kImage}},
      {"clip", R"({"min":0.2})", {kImage}},
      {"affine", R"({"scale":0.3,"shift":-1.25})", {kImage}},
      {"greater", R"({"threshold":0.4})", {kImage}},
      {"concat", R"({"axis":-1})", {{"x0", {2, 3}}, {"x1", {2, 1}}, {"x2", {2, 2}}}},
      {"slice", R"({"axis":-2,"start":1,"end":5})", {kImage}},
      {"pad", R"({"padding":[1,2,3,4],"mode":"reflect"})", {kImage}},
      {"pad", R"({"padding":[1,2,3,4],"mode":"constant","value":-0.75})", {kImage}},
      {"reshape", R"({"shape":[4,72]})", {kImage}},
      {"softmax", R"({"axis":1})", {kImage}},
      {"reduce_min", R"({"axes":[-1]})", {kImage}},
      {"reduce_max", R"({"axes":[2,3]})", {kImage}},
      {"reduce_mean", R"({"axes":[0,1,-2]})", {kImage}},
      {"batch_norm",
       R"({"eps":0.001})",
       {kImage, {"weight", {4}}, {"bias", {4}}, {"running_mean", {4}}, {"running_var", {4}}}},
      {"group_norm", R"({"groups":2,"eps":0.25})", {kImage, {"weight", {4}}, {"bias", {4}}}},
      {"weight_standardise", R"({"eps":0.25})", {{"weight", {3, 2, 3, 3}}}},
      {"layer_norm", R"({"axis":2,"eps":0.001})", {{"x", {2, 3, 5}}, {"weight", {5}}, {"bias", {5}}}},
      {"attention",
       R"({"heads":2,"scale":0.5})",
       {{"query", {1, 6, 5, 1}}, {"key", {1, 6, 5, 1}}, {"value", {1, 6, 5, 1}}}},
      {"permute", R"({"axes":[0,2,3,1]})", {kImage}},
      {"gaussian_blur", R"({"sigma":0.8})", {kImage}},
      {"mirror_known", "{}", {kImage, {"weight", {1, 1, 9, 8}}}},
      {"push_pull_fill", R"({"sweeps":2})", {kImage, {"weight", {1, 1, 9, 8}}}},
      {"guided_coefficients", R"({"radius":2,"eps":0.01})", {{"guide", {1, 3, 9, 8}}, {"x", {1, 1, 9, 8}}}},
      {"foreground_colours", "{}", {{"image", {2, 3, 9, 8}}, {"alpha", {2, 1, 9, 8}}}},
      {"median", R"({"radius":2})", {kImage}},
      {"sobel", "{}", {{"x", {1, 1, 5, 6}}}},
      {"cone_dilation", R"({"rho":0.02,"radius":3})", {kImage}},
  };
  for (const char* op : {"relu", "relu6", "sigmoid", "silu", "gelu", "tanh", "exp", "sqrt", "abs",
                         "min_max_normalise", "distance_transform"})
    all.push_back({op, "{}", {kImage}});
  for (const char* op : {"add", "sub", "mul", "div", "minimum", "maximum"})
    all.push_back({op, "{}", {kImage, {"other", {4, 1, 8}}}});
  return all;
}

/// A case's graph of one operator, and its result in float64.
struct Built {
  Graph graph;
  std::shared_ptr<const Op> op;
  std::vector<Tensor> inputs;  // in the operator's order
  Tensor result;

  explicit Built(const OperatorCase& c) {
    std::vector<std::pair<std::string, Value>> values;
    for (const auto& [name, tensor] : c.inputs) values.emplace_back(name, graph.input(name, tensor.shape()));
    const Node& node = graph.node(ops::build_case(c.op, c.attributes, values).node());
    op = node.op;
    for (const int j : node.inputs)
      for (const auto& [name, tensor] : c.inputs)
        if (name == graph.node(j).name) inputs.push_back(tensor.to(DType::kF64));
    result = Tensor(DType::kF64, node.shape);
    op->reference(inputs, result);
  }
};

bool same_bytes(const Tensor& a, const Tensor& b) {
  return a.dtype() == b.dtype() && a.shape() == b.shape() &&
         std::memcmp(a.raw().data(), b.raw().data(), a.bytes()) == 0;
}

OperatorCase of(const Call& call) {
  OperatorCase c;
  c.op = call.op;
  c.attributes = call.attributes;
  double start = 0.1;
  for (const auto& [name, shape] : call.inputs) c.inputs.emplace_back(name, some(shape, start += 0.17));
  return c;
}

std::string message_of(const std::string& path) {
  try {
    (void)ops::read_case(path);
  } catch (const Error& e) {
    CHECK(e.kind() == ErrorKind::kBadInput);
    return e.what();
  }
  return "";
}

}  // namespace

TEST_CASE("every operator can be written as a case that gives the same operator back") {
  const TemporaryFolder folder;
  std::set<std::string> seen;
  for (const Call& call : calls()) {
    CAPTURE(call.op);
    CAPTURE(call.attributes);
    seen.insert(call.op);
    const Built built(of(call));
    OperatorCase written = ops::case_of(*built.op, built.inputs, built.result);
    written.source = "a test";
    ops::write_case(folder.file("case.safetensors"), written);
    const OperatorCase read = ops::read_case(folder.file("case.safetensors"));
    CHECK(read.op == written.op);
    CHECK(read.attributes == written.attributes);
    CHECK(read.source == "a test");
    REQUIRE(read.inputs.size() == call.inputs.size());
    for (std::size_t i = 0; i < read.inputs.size(); ++i) {
      CHECK(read.inputs[i].first == written.inputs[i].first);
      CHECK(same_bytes(read.inputs[i].second, written.inputs[i].second));
    }
    CHECK(same_bytes(read.expected, built.result));
    const Built again(read);
    CHECK(again.op->type() == built.op->type());
    CHECK(again.op->attributes() == built.op->attributes());
    CHECK(same_bytes(again.result, built.result));
  }
  for (const std::string& op : ops::case_operators())
    CHECK_MESSAGE(seen.contains(op), op, " is not in the table above");
}

TEST_CASE("what is no operator case is refused by name") {
  const TemporaryFolder folder;
  const std::string path = folder.file("x.safetensors");
  const Tensor f = some({2});
  CHECK(message_of(path).find(path) != std::string::npos);
  write_bytes(path, {});
  CHECK(message_of(path).find(path) != std::string::npos);
  write_safetensors(path, {{"expected", f}}, {});
  CHECK(message_of(path) == path + ": not an operator case: there is no metadata \"op\"");
  write_safetensors(path, {{"x", f}}, {{"op", "relu"}});
  CHECK(message_of(path) == path + ": not an operator case: there is no tensor \"expected\"");
  write_safetensors(path, {{"expected", Tensor::zeros(DType::kI32, {2})}}, {{"op", "relu"}});
  CHECK(message_of(path) == path + ": the tensor \"expected\" is I32, F64 or F32 is needed");
  write_safetensors(path, {{"expected", f}, {"x", f}}, {{"op", "relu"}});
  CHECK(message_of(path).empty());
}

TEST_CASE("a folder stands for the case files in it and below, sorted") {
  const TemporaryFolder folder;
  CHECK_THROWS_AS((void)ops::case_files(folder.path().string()), Error);
  CHECK_THROWS_AS((void)ops::case_files(folder.file("missing")), Error);
  std::filesystem::create_directory(folder.path() / "a");
  for (const char* name : {"b.safetensors", "a/z.safetensors", "a/y.safetensors", "readme.md"})
    write_bytes(folder.file(name), {});
  CHECK(ops::case_files(folder.path().string()) == std::vector<std::string>{folder.file("a/y.safetensors"),
                                                                            folder.file("a/z.safetensors"),
                                                                            folder.file("b.safetensors")});
  CHECK(ops::case_files(folder.file("readme.md")) == std::vector<std::string>{folder.file("readme.md")});
}
