#include "graphs/golden_check.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "graphs/catalogue.h"
#include "graphs/compare_report.h"
#include "graphs/photo_inputs.h"
#include "runtime/error.h"
#include "runtime/reference_executor.h"
#include "runtime/safetensors_writer.h"
#include "tests/temporary_folder.h"

using namespace slide;
using graphs::FormulaWeights;
using graphs::Golden;
using graphs::GoldenCheck;

namespace {

/// Weights of which one tensor is off by a part in ten million: a different network, though hardly.
class Nudged : public WeightSource {
 public:
  explicit Nudged(const WeightSource& weights) : weights_(weights) {}
  std::string description() const override { return "nudged"; }
  std::optional<Tensor> find(std::string_view name, const Shape& wanted) const override {
    std::optional<Tensor> t = weights_.find(name, wanted);
    if (!t || name != "conv16.conv.bias") return t;
    Tensor changed = t->to(DType::kF64).clone();
    for (double& v : changed.mutable_data<double>()) v += 1e-7;
    return changed;
  }
  std::vector<std::string> names() const override { return weights_.names(); }

 private:
  const WeightSource& weights_;
};

/// A golden file as small as the network allows. Its numbers come from the float64 executor; that these are
/// PyTorch's is tested elsewhere, with golden files that are.
std::string write_golden(const TemporaryFolder& folder, const WeightSource& weights) {
  Tensor photo(DType::kF64, {1, 3, 16, 20});
  double v = 0;
  for (double& e : photo.mutable_data<double>()) e = v = std::fmod(v + 0.618, 1.0);
  const graphs::PhotoRun run = graphs::photo_run("inpaint_coarse", photo, weights);
  std::vector<std::pair<std::string, Tensor>> tensors;
  NamedTensors inputs;
  for (const auto& [name, tensor] : run.inputs) {
    inputs[name] = tensor.to(DType::kF32);
    tensors.emplace_back("input." + name, inputs[name]);
  }
  ReferenceExecutor reference(*run.graph, weights);
  reference.run(inputs, {"conv5", "conv11"});
  tensors.emplace_back("output.0", reference.tensor("0"));
  for (const char* tap : {"conv5", "conv11"})
    tensors.emplace_back(std::string("tap.") + tap, reference.tensor(tap).to(DType::kF32));
  const std::string path = folder.file("golden.safetensors");
  write_safetensors(path, tensors, {{"network", "inpaint_coarse"}, {"salt", ""}, {"scales", "{}"}});
  return path;
}

}  // namespace

TEST_CASE("a golden run holds for the float64 executor, and every kernel for its bound") {
  const TemporaryFolder folder;
  const FormulaWeights weights = FormulaWeights::made_up();
  const GoldenCheck check = graphs::check_golden(Golden::open(write_golden(folder, weights)), weights);
  CHECK(check.passed());
  CHECK(check.network == "inpaint_coarse");
  REQUIRE(check.tensors.size() == 3);
  for (const graphs::GoldenTensorCheck& t : check.tensors) {
    CAPTURE(t.name);
    CHECK(t.output == (t.name == "0"));
    CHECK(t.tolerance == (t.output ? 1e-9 : 1e-6));
    if (t.output) {
      CHECK(t.reference_error == 0);  // the same numbers, in float64
    } else {
      CHECK(t.reference_error > 0);  // rounded to float32
      CHECK(t.reference_error <= 0x1p-24);
    }
    CHECK(t.fast.max > 0);
    CHECK(t.fast.rms > 0);
  }
  const nlohmann::json json = nlohmann::json::parse(graphs::json_of(check));
  CHECK(json["passed"] == true);
  CHECK(json["tensors"].size() == 3);
  CHECK(json["nodes"].size() == check.comparison.nodes.size());
  CHECK(graphs::table_of(check).find("FAILED") == std::string::npos);
}

TEST_CASE("the errors of a golden run's tensors are those of the nodes that make them") {
  const TemporaryFolder folder;
  const FormulaWeights weights = FormulaWeights::made_up();
  const Golden golden = Golden::open(write_golden(folder, weights));
  const GoldenCheck check = graphs::check_golden(golden, weights);
  const std::unique_ptr<Graph> graph = golden.build(weights);
  for (const graphs::GoldenTensorCheck& t : check.tensors) {
    const auto node =
        std::ranges::find(check.comparison.nodes, graph->find(t.name).value(), &graphs::NodeComparison::node);
    REQUIRE(node != check.comparison.nodes.end());
    CHECK(t.fast.max == node->accumulated.max);
    CHECK(t.fast.rms == node->accumulated.rms);
  }
}

TEST_CASE("a network that is not quite the golden one fails, though every kernel is right") {
  const TemporaryFolder folder;
  const FormulaWeights weights = FormulaWeights::made_up();
  const GoldenCheck check =
      graphs::check_golden(Golden::open(write_golden(folder, weights)), Nudged(weights));
  CHECK_FALSE(check.passed());
  CHECK(check.comparison.passed());
  CHECK(graphs::table_of(check).find("FAILED") != std::string::npos);
}
