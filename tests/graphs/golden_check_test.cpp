#include "graphs/golden_check.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "graphs/compare_report.h"

using namespace slide;
using graphs::Golden;
using graphs::GoldenCheck;

namespace {

/// The float64 weights with one changed by a part in ten million: a different network, though hardly.
class Nudged : public WeightSource {
 public:
  explicit Nudged(const WeightSource& weights) : weights_(weights) {}
  std::string description() const override { return "nudged"; }
  std::optional<Tensor> find(std::string_view name, const Shape& wanted) const override {
    std::optional<Tensor> t = weights_.find(name, wanted);
    if (!t || name != "scratch.output_conv.0.bias") return t;
    Tensor changed = t->to(DType::kF64).clone();
    for (double& v : changed.mutable_data<double>()) v += 1e-7;
    return changed;
  }
  std::vector<std::string> names() const override { return weights_.names(); }

 private:
  const WeightSource& weights_;
};

const char* const kGolden = SLIDE_TEST_DATA "/networks/midas_v21_small.safetensors";

}  // namespace

TEST_CASE("a golden run holds for the float64 executor, and every kernel for its bound") {
  const Golden golden = Golden::open(kGolden);
  const GoldenCheck check = graphs::check_golden(golden, golden.weights());
  CHECK(check.passed());
  CHECK(check.network == "midas_v21_small");
  CHECK(check.tensors.size() == golden.taps().size() + 1);
  const auto output = std::ranges::find(check.tensors, true, &graphs::GoldenTensorCheck::output);
  REQUIRE(output != check.tensors.end());
  CHECK(output->tolerance == 1e-9);
  CHECK(output->fast.max > 0);
  for (const graphs::GoldenTensorCheck& t : check.tensors) {
    CAPTURE(t.name);
    CHECK(t.fast.max < 1e-3);
    CHECK(t.fast.rms <= 10 * t.fast.max);
  }
  const nlohmann::json json = nlohmann::json::parse(graphs::json_of(check));
  CHECK(json["passed"] == true);
  CHECK(json["tensors"].size() == check.tensors.size());
  CHECK(json["nodes"].size() == check.comparison.nodes.size());
  CHECK(graphs::table_of(check).find("FAILED") == std::string::npos);
}

TEST_CASE("a network that is not quite the golden one fails, though every kernel is right") {
  const Golden golden = Golden::open(kGolden);
  const graphs::FormulaWeights formula = golden.weights();
  const GoldenCheck check = graphs::check_golden(golden, Nudged(formula));
  CHECK_FALSE(check.passed());
  CHECK(check.comparison.passed());
  CHECK(graphs::table_of(check).find("FAILED") != std::string::npos);
}
