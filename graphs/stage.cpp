#include "graphs/stage.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "ops/fusion/fusion.h"

namespace slide::graphs {
namespace {

const WeightMap kNoWeights("a stage without weights");

constexpr std::size_t kMostStages = 16;  // that are kept: windows of many sizes must not gather

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

void count(const Graph& graph, const Plan& plan, StageReport& report) {
  report.memory = plan.memory_bytes();
  report.predicted_error = plan.predicted_error;
  for (const PlanStep& step : plan.steps) {
    if (step.kernel->precision() == Precision::kBf16) ++report.bf16_layers;
    if (step.kernel->precision() == Precision::kInt8) ++report.int8_layers;
    const Node& node = graph.node(step.node);
    std::vector<Shape> shapes;
    for (const int j : node.inputs) shapes.push_back(graph.node(j).shape);
    report.gflop += 2e-9 * node.op->macs(shapes, node.shape);
  }
}

/// Everything that the graph, its plan and its packed weights depend on. `weights` stands for the source:
/// one network may come from two files.
std::string key_of(const std::string& stage, const NetworkChoice& network, const SlideOptions& options,
                   const NamedTensors& inputs, std::int64_t variant) {
  std::string key =
      stage + " " + network.model + " " + std::to_string(reinterpret_cast<std::uintptr_t>(network.weights)) +
      " " + std::to_string(network.side) + " " + std::to_string(variant) + " " +
      std::to_string(static_cast<int>(options.isa)) + " " +
      std::to_string(static_cast<int>(options.precision)) + " " + std::to_string(options.error_budget);
  for (const auto& [name, tensor] : inputs) key += " " + name + " " + tensor.shape().text();
  return key;
}

}  // namespace

void PreparedStages::allow(std::size_t bytes) {
  allowed_ = bytes;
  forget_what_is_too_much();
}

std::size_t PreparedStages::kept_bytes() const noexcept {
  std::size_t bytes = 0;
  for (const auto& stage : kept_) bytes += stage->executor->plan().weight_bytes;
  return bytes;
}

std::shared_ptr<PreparedStage> PreparedStages::find(const std::string& key) {
  const auto found = std::ranges::find(kept_, key, [](const auto& stage) { return stage->key; });
  if (found == kept_.end()) return nullptr;
  kept_.splice(kept_.begin(), kept_, found);
  return kept_.front();
}

void PreparedStages::keep(std::shared_ptr<PreparedStage> stage) {
  kept_.push_front(std::move(stage));
  forget_what_is_too_much();
}

std::shared_ptr<Workspace> PreparedStages::workspace() const {
  return allowed_ == 0 ? std::make_shared<Workspace>() : workspace_;
}

void PreparedStages::forget_what_is_too_much() {
  while (!kept_.empty() && (kept_bytes() > allowed_ || kept_.size() > kMostStages)) kept_.pop_back();
}

Stage::Stage(std::string name, const StageContext& context, const NetworkChoice& network)
    : context_(context), network_(network) {
  report_.name = std::move(name);
}

void Stage::prepare(const NamedTensors& inputs, const BuildStage& build, std::int64_t variant) {
  const auto start = Clock::now();
  const SlideOptions& options = context_.options;
  const bool chosen = network_.chosen();
  const std::string key = chosen ? key_of(report_.name, network_, options, inputs, variant) : "";
  if (chosen) prepared_ = context_.prepared.find(key);
  if (prepared_) {
    report_ = prepared_->report;
    report_.reused = true;
    return;
  }
  prepared_ = std::make_shared<PreparedStage>();
  prepared_->key = key;
  Graph graph;
  build(graph);
  prepared_->graph = ops::fuse(graph);
  prepared_->executor =
      std::make_unique<FastExecutor>(*prepared_->graph, chosen ? *network_.weights : kNoWeights,
                                     FastOptions{.isa = options.isa,
                                                 .memory_limit = options.memory_limit,
                                                 .precision = chosen ? options.precision : Precision::kFp32,
                                                 .error_budget = chosen ? options.error_budget : 0,
                                                 .workspace = context_.prepared.workspace()});
  count(*prepared_->graph, prepared_->executor->plan(), report_);
  prepared_->report = report_;
  if (chosen) context_.prepared.keep(prepared_);
  report_.preparing = seconds_since(start);
  report_.seconds = report_.preparing;
}

void Stage::run(const NamedTensors& inputs, const BuildStage& build, std::int64_t variant, Part part) {
  prepare(inputs, build, variant);
  const auto start = Clock::now();
  RunOptions run_options;
  if (context_.options.progress)
    run_options.progress = [&](const Progress& p) {
      return context_.options.progress(report_.name, part.first + part.size * p.done / std::max(1, p.total),
                                       p.node);
    };
  prepared_->executor->run(inputs, run_options);
  report_.seconds += seconds_since(start);
}

Tensor Stage::take(std::string_view output) const { return prepared_->executor->tensor(output).clone(); }

PlannedStage plan_stage(std::string name, const SlideOptions& options, const BuildStage& build,
                        const NetworkChoice& network) {
  PlannedStage planned;
  planned.report.name = std::move(name);
  Graph graph;
  build(graph);
  planned.graph = ops::fuse(graph);
  const bool chosen = network.chosen();
  planned.plan = make_plan(*planned.graph, {.isa = options.isa,
                                            .precision = chosen ? options.precision : Precision::kFp32,
                                            .error_budget = chosen ? options.error_budget : 0,
                                            .calibration = chosen ? network.weights->calibration() : nullptr,
                                            .weights = chosen ? network.weights : nullptr});
  count(*planned.graph, planned.plan, planned.report);
  return planned;
}

}  // namespace slide::graphs
