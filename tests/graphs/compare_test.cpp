#include "graphs/compare.h"

#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>

#include "graphs/catalogue.h"
#include "graphs/compare_report.h"
#include "graphs/formula_weights.h"
#include "graphs/photo_inputs.h"
#include "ops/case_io.h"
#include "ops/check_report.h"
#include "ops/conv2d/conv2d.h"
#include "ops/pointwise/pointwise.h"
#include "ops/tensor_shape/tensor_shape.h"
#include "runtime/error.h"
#include "tests/temporary_folder.h"

using namespace slide;

namespace {

/// The identity, with a kernel that is off by 2^-20 where its bound says exact.
class OffOp : public Op {
 public:
  class OffKernel : public Kernel {
   public:
    std::string_view name() const override { return "off.plain"; }
    Isa isa() const override { return Isa::kBaseline; }
    bool supports(const Op&, std::span<const Shape>, const Shape&) const override { return true; }
    double error_factor(const Op&, std::span<const Shape>) const override { return 0; }
    void run(const Op&, std::span<const Tensor> inputs, Tensor& output,
             const KernelCall& /*call*/) const override {
      const std::span<const float> x = inputs[0].data<float>();
      for (std::size_t i = 0; i < x.size(); ++i) output.mutable_data<float>()[i] = x[i] * (1 + 0x1p-20F);
    }
  };
  std::string_view type() const override { return "off"; }
  Shape infer(std::span<const Shape> inputs) const override { return inputs[0]; }
  void reference(std::span<const Tensor> inputs, Tensor& output) const override {
    output = inputs[0].clone();
  }
  std::span<const Kernel* const> kernels() const override {
    static const OffKernel kernel;
    static const std::array<const Kernel*, 1> all{&kernel};
    return all;
  }
};

/// A convolution whose weights are standardised before, twice over a parameter, then relu, concat and a tap.
void build(Graph& g) {
  const Value x = g.input("x", {1, 2, 6, 7});
  const Value w = ops::affine(g.parameter("conv.weight", {3, 2, 3, 3}), 0.5, 0);
  const Value y = ops::relu(ops::conv2d(x, w, g.parameter("conv.bias", {3}), ops::Conv2dParams::same(3)));
  g.tap("conv", y);
  g.output("y", ops::concat({y, ops::sigmoid(y)}, 1));
}

Tensor wave(const Shape& shape, double frequency) {
  Tensor t(DType::kF64, shape);
  double i = 0;
  for (double& v : t.mutable_data<double>()) v = std::sin(frequency * ++i);
  return t;
}

WeightMap weights() {
  WeightMap map;
  map.set("conv.weight", wave({3, 2, 3, 3}, 1.3));
  map.set("conv.bias", wave({3}, 0.4));
  return map;
}

NamedTensors inputs() { return {{"x", wave({1, 2, 6, 7}, 0.7)}}; }

const graphs::NodeComparison& node_named(const graphs::Comparison& c, const std::string& name) {
  for (const graphs::NodeComparison& n : c.nodes)
    if (n.name == name) return n;
  throw std::runtime_error("no node " + name);
}

}  // namespace

TEST_CASE("every computed node is compared, folded ones are not") {
  Graph g;
  build(g);
  std::vector<std::string> visited;
  std::vector<std::string> without_fast;
  graphs::CompareOptions options;
  options.visit = [&](int node, const Tensor& reference, const Tensor& fast) {
    visited.push_back(g.node(node).name);
    CHECK(reference.dtype() == DType::kF64);
    if (fast.empty())
      without_fast.push_back(g.node(node).name);
    else
      CHECK(ops::relative_error(fast, reference) < 1e-6);
  };
  const graphs::Comparison c = graphs::compare(g, weights(), inputs(), options);
  CHECK(c.passed());
  CHECK(visited == std::vector<std::string>{"affine", "conv2d", "relu", "sigmoid", "concat"});
  CHECK(without_fast == std::vector<std::string>{"affine"});
  REQUIRE(c.nodes.size() == 4);
  CHECK(c.nodes[0].name == "conv2d");
  CHECK(c.nodes[0].shape == Shape{1, 3, 6, 7});
  CHECK(c.nodes[0].accumulated.max > 0);  // x is no float32
  CHECK(c.nodes[0].accumulated.max < 1e-6);
  CHECK(c.nodes[0].accumulated.rms <= c.nodes[0].accumulated.max * std::sqrt(3 * 6 * 7));
  CHECK(c.nodes[1].local.error_reference == 0);  // relu is exact, what it inherits is not its error
  CHECK(c.nodes[1].accumulated.max > 0);
}

TEST_CASE("a kernel over its bound fails at its own node only; those after it show what it adds up to") {
  Graph g;
  const Value x = g.input("x", {1, 2, 6, 7});
  const Value off = g.add(std::make_shared<OffOp>(), {ops::relu(x)});
  g.output("y", ops::relu(off));
  const graphs::Comparison c = graphs::compare(g, WeightMap(), inputs());
  CHECK_FALSE(c.passed());
  CHECK(node_named(c, "relu").local.passed());
  CHECK_FALSE(node_named(c, "off").local.passed());
  CHECK(node_named(c, "relu_2").local.passed());
  CHECK(node_named(c, "relu").accumulated.max < 0x1p-24);
  CHECK(node_named(c, "relu_2").accumulated.max == doctest::Approx(0x1p-20).epsilon(0.1));
  CHECK(node_named(c, "relu_2").accumulated.rms == doctest::Approx(0x1p-20).epsilon(0.1));

  const std::string table = graphs::table_of(c);
  CHECK(table.find("1 kernels FAILED") != std::string::npos);
  CHECK(table.find("FAILED: over its bound") != std::string::npos);
  CHECK(graphs::table_of(c, 1).find("off.plain.baseline") != std::string::npos);
  const nlohmann::json json = nlohmann::json::parse(graphs::json_of("toy", c));
  CHECK(json["passed"] == false);
  REQUIRE(json["nodes"].size() == 3);
  CHECK(json["nodes"][1]["node"] == "off");
  CHECK(json["nodes"][1]["passed"] == false);
  CHECK(json["nodes"][2]["max_error"].get<double>() == node_named(c, "relu_2").accumulated.max);
}

TEST_CASE("on request the outputs of the fused plan are compared with the graph as it was built") {
  Graph g;
  build(g);
  CHECK(graphs::compare(g, weights(), inputs()).fused.empty());
  graphs::CompareOptions options;
  options.fused = true;
  const graphs::Comparison c = graphs::compare(g, weights(), inputs(), options);
  CHECK(c.nodes.size() == 4);  // convolution and ReLU as nodes of their own
  REQUIRE(c.fused.size() == 1);
  CHECK(c.fused[0].name == "y");
  CHECK(c.fused[0].error.max > 0);  // x is no float32
  CHECK(c.fused[0].error.max < 1e-6);
  CHECK(graphs::table_of(c).find("fused plan vs float64") != std::string::npos);
  const nlohmann::json json = nlohmann::json::parse(graphs::json_of("toy", c));
  REQUIRE(json["fused"].size() == 1);
  CHECK(json["fused"][0]["output"] == "y");
  CHECK(json["fused"][0]["rms_error"].get<double>() == c.fused[0].error.rms);
}

TEST_CASE("a kernel that is off shows in the outputs of the fused plan") {
  Graph g;
  const Value x = g.input("x", {1, 2, 6, 7});
  g.output("y", ops::relu(g.add(std::make_shared<OffOp>(), {x})));
  graphs::CompareOptions options;
  options.fused = true;
  const graphs::Comparison c = graphs::compare(g, WeightMap(), inputs(), options);
  REQUIRE(c.fused.size() == 1);
  CHECK(c.fused[0].error.max == doctest::Approx(0x1p-20).epsilon(0.1));
}

// Convolutions of 32 channels have kernels of every precision. Between two of them 8-bit integers err by about
// 1 % and bfloat16 by 0.2 to 1 %, which no float32 kernel does.
TEST_CASE("nodes are judged in the precision that the plan gives them") {
  Graph g;
  Value y = g.input("x", {1, 32, 12, 16});
  for (const char* name : {"a", "b", "c"})
    y = ops::conv2d(y, g.parameter(std::string(name) + ".weight", {32, 32, 1, 1}), std::nullopt, {});
  g.output("y", y);
  const NamedTensors x = {{"x", wave({1, 32, 12, 16}, 0.7)}};
  for (const Precision precision : {Precision::kFp32, Precision::kBf16, Precision::kInt8}) {
    CAPTURE(name_of(precision));
    graphs::CompareOptions options;
    options.precision = precision;
    const graphs::Comparison c = graphs::compare(g, graphs::FormulaWeights::made_up(), x, options);
    CHECK(c.passed());
    REQUIRE(c.nodes.size() == 3);
    const graphs::NodeComparison& middle = c.nodes[1];
    const bool exact = middle.precision == Precision::kFp32;
    if (runs_at(Isa::kAmx, active_isa())) CHECK(middle.precision == precision);
    CHECK((middle.local.rms < 1e-6) == exact);
    CHECK((exact || middle.accumulated.rms > 1e-4));
    const nlohmann::json json = nlohmann::json::parse(graphs::json_of("toy", c));
    CHECK(json["nodes"][1]["precision"] == std::string(name_of(middle.precision)));
    CHECK(json["nodes"][1]["rms"].get<double>() == middle.local.rms);
    CHECK(json["nodes"][1]["expected_rms"].get<double>() == middle.local.expected_rms);
  }
}

TEST_CASE("dumped nodes are operator cases that pass the check") {
  const TemporaryFolder folder;
  Graph g;
  build(g);
  graphs::CompareOptions options;
  options.dump_folder = folder.file("made/on the way");
  options.source = "toy";
  const graphs::Comparison c = graphs::compare(g, weights(), inputs(), options);
  CHECK(c.dumped == 4);
  const std::vector<ops::CheckedFile> files = ops::check_files({options.dump_folder}, detected_isa());
  REQUIRE(files.size() == 4);
  CHECK(ops::exit_code(files) == 0);
  CHECK(files[0].check->op == "conv2d");
  CHECK(files[0].check->source == "toy conv2d");
  for (const ops::CheckedFile& f : files)
    CHECK(f.check->reference_error == 0);  // the same definition on the same numbers
  // The kernel of the plan is among those checked, on the same numbers.
  bool found = false;
  for (const ops::KernelCheck& k : files[0].check->kernels)
    if (k.kernel == c.nodes[0].local.kernel) found = k.of_bound == c.nodes[0].local.of_bound;
  CHECK(found);
}

TEST_CASE("a dump replaces its own cases, and other files only if told to") {
  const TemporaryFolder folder;
  Graph g;
  build(g);
  graphs::CompareOptions options;
  options.dump_folder = folder.path().string();
  options.source = "toy";
  const auto dump = [&] { return graphs::compare(g, weights(), inputs(), options).dumped; };
  CHECK(dump() == 4);
  CHECK(dump() == 4);
  const std::vector<std::string> files = ops::case_files(options.dump_folder);
  REQUIRE(files.size() == 4);
  const auto refused = [&] {
    try {
      (void)dump();
    } catch (const Error& e) {
      return e.kind() == ErrorKind::kUsage && std::string(e.what()).find(files[2]) != std::string::npos;
    }
    return false;
  };
  // Somebody's own case of that name, and something else.
  ops::OperatorCase other = ops::read_case(files[1]);
  other.source = "not of this network";
  ops::write_case(files[2], other);
  CHECK(refused());
  CHECK(ops::read_case(files[2]).source == "not of this network");
  const std::string notes = "my notes";
  write_bytes(files[2], std::as_bytes(std::span(notes)));
  CHECK(refused());
  CHECK(std::filesystem::file_size(files[2]) == notes.size());
  options.overwrite = true;
  CHECK(dump() == 4);
  CHECK(ops::read_case(files[2]).source.starts_with("toy "));
}

TEST_CASE("a folder that cannot be made is an error, and cancelling ends the run") {
  const TemporaryFolder folder;
  write_bytes(folder.file("file"), {});
  Graph g;
  build(g);
  graphs::CompareOptions options;
  options.dump_folder = folder.file("file/below");
  CHECK_THROWS_AS((void)graphs::compare(g, weights(), inputs(), options), Error);
  options.dump_folder.clear();
  options.progress = [](const Progress& p) { return p.node != "relu"; };
  CHECK_THROWS_WITH_AS((void)graphs::compare(g, weights(), inputs(), options), "cancelled before layer relu",
                       Error);
}

TEST_CASE("the error of a tensor: largest and root mean square, relative") {
  const double a[] = {1, 2, 3, -4};
  const double b[] = {1, 2, 3.5, -4};
  const auto tensor = [](const double(&v)[4]) {
    return Tensor::from<double>({4}, std::span<const double>(v));
  };
  const graphs::TensorError e = graphs::tensor_error(tensor(a), tensor(b));
  CHECK(e.max == 0.125);
  CHECK(e.rms == doctest::Approx(0.5 / std::sqrt(33.25)));
  CHECK(graphs::tensor_error(tensor(a), tensor(a)).rms == 0);
  const double c[] = {1, 2, 3, std::numeric_limits<double>::quiet_NaN()};
  CHECK(std::isinf(graphs::tensor_error(tensor(a), tensor(c)).max));
  CHECK(std::isinf(graphs::tensor_error(tensor(a), tensor(c)).rms));
}

TEST_CASE("a photo becomes the inputs of every model of the catalogue") {
  Tensor photo(DType::kF32, {1, 3, 30, 44});
  float v = 0;
  for (float& e : photo.mutable_data<float>()) e = v = std::fmod(v + 0.618F, 1.0F);
  const graphs::FormulaWeights formula = graphs::FormulaWeights::made_up();
  for (const graphs::Model& model : graphs::catalogue()) {
    const std::string name(model.name);
    CAPTURE(name);
    const graphs::PhotoRun run = graphs::photo_run(name, photo, formula, 64);
    REQUIRE(run.inputs.size() == model.inputs.size());
    for (const Node& node : run.graph->nodes()) {
      if (node.kind != NodeKind::kInput) continue;
      const auto given = run.inputs.find(node.name);
      REQUIRE(given != run.inputs.end());
      CHECK(given->second.shape() == node.shape);
      CHECK(node.shape[3] == (model.size.multiple == 14 ? 70 : 64));  // the nearest that fits
      CHECK(node.shape[2] % model.size.multiple == 0);
      CHECK(std::isfinite(max_abs(given->second)));
    }
  }
  CHECK_THROWS_AS((void)graphs::photo_run("no_such_model", photo, formula), Error);
  CHECK_THROWS_AS((void)graphs::photo_run("u2netp", photo, formula, -1), Error);
}

TEST_CASE("what a photo does not hold is made up as documented") {
  const Tensor photo = Tensor::zeros(DType::kF32, {1, 3, 64, 64});
  const graphs::FormulaWeights formula = graphs::FormulaWeights::made_up();
  const graphs::PhotoRun inpaint = graphs::photo_run("inpaint_coarse", photo, formula);
  double hole = 0;
  for (const double m : inpaint.inputs.at("mask").data<double>()) hole += m;
  CHECK(hole == 32 * 32);
  for (const double x : inpaint.inputs.at("rgbd").data<double>()) CHECK(x == -1);

  const graphs::PhotoRun matting = graphs::photo_run("fba", photo, formula);
  const std::span<const double> trimap = matting.inputs.at("two_chan_trimap").data<double>();
  const std::span<const double> distances = matting.inputs.at("trimap_transformed").data<double>();
  double foreground = 0;
  for (std::size_t i = 0; i < 64 * 64; ++i) {
    CHECK(trimap[i] * trimap[64 * 64 + i] == 0);
    foreground += trimap[64 * 64 + i];
    CHECK((distances[i] == 1) == (trimap[i] == 1));  // distance 0 from the sure background
  }
  CHECK(foreground == doctest::Approx(3.14159 * 16 * 16).epsilon(0.02));
}
