#include "graphs/golden.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "graphs/catalogue.h"
#include "graphs/fba.h"
#include "runtime/fast_executor.h"
#include "runtime/reference_executor.h"
#include "tests/graphs/network_support.h"

using namespace slide;
using namespace slide::graphs;

namespace {

/// The golden files are runs of the authors' code in float64: outputs are stored in float64, intermediate
/// tensors in float32.
constexpr double kOutputTolerance = 1e-9;
constexpr double kTapTolerance = 1e-6;

/// How far the float32 kernels' outputs may be from PyTorch's in float64, as part of the largest magnitude:
/// rounding errors carried through the whole network. PyTorch's own float32 is up to 8.5e-5 away (u2netp),
/// ours 7.1e-5: see docs/networks.md.
constexpr double kFastTolerance = 1e-4;

void check_golden(const std::string& network) {
  const Golden golden = golden_file(network);
  REQUIRE(golden.network() == network);
  const FormulaWeights formula = golden.weights();
  const std::unique_ptr<Graph> graph = golden.build(formula);
  const WeightMap weights = weights_in_memory(*graph, formula);
  ReferenceExecutor run(*graph, weights);
  run.run(golden.inputs(*graph), golden.taps());
  const auto errors = golden.compare([&](const std::string& name) { return run.tensor(name); });
  std::size_t outputs = 0;
  for (const GoldenError& e : errors) {
    CAPTURE(e.name);
    CHECK(e.magnitude > 0.1);
    CHECK(e.error <= (e.output ? kOutputTolerance : kTapTolerance));
    outputs += e.output ? 1 : 0;
  }
  CHECK(outputs == graph->outputs().size());
  CHECK(errors.size() == outputs + golden.taps().size());

  FastExecutor fast(*graph, weights, {.keep_all = true});
  fast.run(golden.inputs(*graph));
  for (const GoldenError& e : golden.compare([&](const std::string& name) { return fast.tensor(name); })) {
    CAPTURE(e.name);
    if (e.output) CHECK(e.error <= kFastTolerance);
  }
}

}  // namespace

TEST_CASE("inpaint_coarse gives the numbers of its definition in PyTorch") { check_golden("inpaint_coarse"); }

TEST_CASE("inpaint_deepfill gives the numbers of nipponjo's PyTorch code") {
  check_golden("inpaint_deepfill");
}

TEST_CASE("midas_v21_small gives the numbers of the authors' PyTorch code") {
  check_golden("midas_v21_small");
}

TEST_CASE("midas_v21 gives the numbers of the authors' PyTorch code" * doctest::skip(quick())) {
  check_golden("midas_v21");
}

TEST_CASE("depth_anything_v2_vits gives the numbers of the authors' PyTorch code" * doctest::skip(quick())) {
  check_golden("depth_anything_v2_vits");
}

TEST_CASE("u2netp gives the numbers of the authors' PyTorch code") { check_golden("u2netp"); }

TEST_CASE("u2net gives the numbers of the authors' PyTorch code" * doctest::skip(quick())) {
  check_golden("u2net");
}

TEST_CASE("fba gives the numbers of the authors' PyTorch code" * doctest::skip(quick())) {
  check_golden("fba");
}

TEST_CASE("fba standardises raw filters as the authors' eval() does" * doctest::skip(quick())) {
  const Golden golden = golden_file("fba_raw_weights");
  const FormulaWeights formula = golden_file("fba").weights();
  // The same weights as a file would hold them, that is with names: the graph looks at their values.
  const auto shapes = build_model("fba", {.height = 32, .width = 40});
  const WeightMap weights = weights_in_memory(*shapes, formula);
  REQUIRE(FbaConfig::from_weights(weights).standardise_weights);
  const auto graph = build_model("fba", {.height = 32, .width = 40, .weights = &weights});
  ReferenceExecutor run(*graph, weights);
  run.run(golden.inputs(*graph));
  const auto errors = golden.compare([&](const std::string& name) { return run.tensor(name); });
  REQUIRE(errors.size() == 1);
  CHECK(errors[0].error <= kOutputTolerance);
}

TEST_CASE(
    "a network's parameters are exactly those of the golden file, but for those no forward pass reads") {
  for (const Model& model : catalogue()) {
    if (model.name.starts_with("slide_")) continue;  // ours: no authors' list of parameters
    if (model.name == "depth_anything_v2_vitb" || model.name == "depth_anything_v2_vitl")
      continue;  // built by the function that depth_anything_v2_vits stands for
    CAPTURE(model.name);
    const Golden golden = golden_file(std::string(model.name));
    const FormulaWeights weights = golden.weights();
    const std::unique_ptr<Graph> graph = golden.build(weights);
    std::set<std::string> unread;
    for (const std::string& name : weights.golden_names()) unread.insert(name);
    for (const Node& node : graph->nodes())
      if (node.kind == NodeKind::kParameter) CHECK(unread.erase(node.name) == 1);
    for (const std::string& name : unread) {
      CAPTURE(name);
      CHECK(std::ranges::any_of(model.unread, [&](std::string_view p) { return name.starts_with(p); }));
    }
  }
}

TEST_CASE("a golden comparison sees one wrong element, a missing element and NaN") {
  const Golden golden = golden_file("inpaint_coarse");
  const std::unique_ptr<Graph> graph = golden.build(golden.weights());
  const SafetensorsFile file =
      SafetensorsFile::open(std::string(SLIDE_TEST_DATA) + "/networks/inpaint_coarse.safetensors");
  const auto compare_with = [&](Tensor output) {
    return golden.compare([&](const std::string& name) {
      return name == "0" ? output : Tensor::zeros(DType::kF64, graph->node(*graph->find(name)).shape);
    });
  };
  const auto error_of_output = [](const std::vector<GoldenError>& errors) {
    return std::ranges::find(errors, "0", &GoldenError::name)->error;
  };
  Tensor output = file.tensor("output.0").clone();
  CHECK(error_of_output(compare_with(output)) == 0);
  output.mutable_data<double>().back() += 1e-3;
  CHECK(error_of_output(compare_with(output)) == doctest::Approx(1e-3 / max_abs(file.tensor("output.0"))));
  output.mutable_data<double>().back() = NAN;
  CHECK(std::isinf(error_of_output(compare_with(output))));
  const std::string message = message_of([&] {
    (void)compare_with(Tensor::zeros(DType::kF64, {1, 4, 72, 100}));
  });
  CHECK(message.find("output.0") != std::string::npos);
  CHECK(message.find("1x4x72x100") != std::string::npos);
}
