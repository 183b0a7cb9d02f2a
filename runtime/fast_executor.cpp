#include "runtime/fast_executor.h"

#include <algorithm>
#include <chrono>

#include "runtime/error.h"
#include "runtime/lifetime.h"
#include "runtime/threads.h"

namespace slide {
namespace {

std::string mebibytes(std::size_t bytes) { return std::to_string((bytes + (1U << 20) - 1) >> 20) + " MiB"; }

const Calibration* calibration_of(const WeightSource& weights, const FastOptions& options) {
  return options.calibration != nullptr ? options.calibration : weights.calibration();
}

}  // namespace

FastExecutor::FastExecutor(const Graph& graph, const WeightSource& weights, const FastOptions& options)
    : graph_(graph),
      plan_(make_plan(graph, {.isa = options.isa,
                              .keep_all = options.keep_all,
                              .precision = options.precision,
                              .error_budget = options.error_budget,
                              .calibration = calibration_of(weights, options),
                              .weights = &weights,
                              .only_precision = options.only_precision})),
      keep_all_(options.keep_all),
      workspace_(options.workspace ? options.workspace : std::make_shared<Workspace>()) {
  if (options.memory_limit != 0 && plan_.memory_bytes() > options.memory_limit)
    throw Error(ErrorKind::kOutOfMemory,
                "the plan needs " + mebibytes(plan_.memory_bytes()) + " (" + mebibytes(plan_.arena_bytes) +
                    " of results, " + mebibytes(plan_.weight_bytes) +
                    " of weights), more than the limit of " + mebibytes(options.memory_limit),
                "allow more memory or use a smaller size");
  constants_ =
      load_constants(graph, plan_, weights, {workspace_->reserve(plan_.arena_bytes), plan_.arena_bytes});
  values_ = std::move(constants_.values);
  ranges_.resize(plan_.steps.size());
  if (const Calibration* calibration = calibration_of(weights, options))
    for (std::size_t s = 0; s < plan_.steps.size(); ++s)
      if (const LayerCalibration* layer = calibration->find(graph, plan_.steps[s].node))
        ranges_[s] = layer->range;
  bind_results();
}

void FastExecutor::bind_results() {
  std::byte* const memory = workspace_->reserve(plan_.arena_bytes);
  if (memory == memory_) return;
  memory_ = memory;
  for (const PlanStep& step : plan_.steps)
    values_[static_cast<std::size_t>(step.node)] =
        Tensor::view(DType::kF32, graph_.node(step.node).shape, memory_ + step.offset);
}

void FastExecutor::run(const NamedTensors& inputs, const RunOptions& options) {
  const FlushDenormals flush;
  bind_results();
  for (std::size_t i = 0; i < graph_.nodes().size(); ++i)
    if (graph_.nodes()[i].kind == NodeKind::kInput)
      values_[i] = checked_input(graph_.nodes()[i], inputs).to(DType::kF32);
  const int total = static_cast<int>(plan_.steps.size());
  for (int s = 0; s < total; ++s) {
    const PlanStep& step = plan_.steps[static_cast<std::size_t>(s)];
    const Node& node = graph_.node(step.node);
    if (options.progress && !options.progress({s, total, node.name}))
      throw Error(ErrorKind::kCancelled, "cancelled before layer " + node.name);
    std::vector<Tensor> arguments;
    const std::vector<Shape> shapes = input_shapes(graph_, node);
    Tensor& result = values_[static_cast<std::size_t>(step.node)];
    double bytes = static_cast<double>(result.bytes());
    for (const int j : node.inputs) {
      arguments.push_back(values_[static_cast<std::size_t>(j)]);
      bytes += static_cast<double>(arguments.back().bytes());
    }
    const auto start = std::chrono::steady_clock::now();
    run_step(static_cast<std::size_t>(s), arguments, shapes, result);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    if (options.profile != nullptr)
      options.profile->push_back(
          {node.name, step.kernel->name_and_level(), took.count(), node.op->macs(shapes, node.shape), bytes});
  }
}

void FastExecutor::run_step(std::size_t s, std::span<const Tensor> inputs, std::span<const Shape> shapes,
                            Tensor& result) {
  const PlanStep& step = plan_.steps[s];
  const Op& op = *graph_.node(step.node).op;
  const std::span<std::byte> scratch{memory_ + step.scratch_offset, step.scratch_bytes};
  if (step.packed_once)
    return step.kernel->run(op, inputs, result, {shapes, constants_.packed[s], scratch, ranges_[s]});
  const std::span<std::byte> packed = scratch.first(step.packed_bytes);
  step.kernel->pack(op, inputs, shapes, packed);
  step.kernel->run(op, inputs, result, {shapes, packed, scratch.subspan(step.packed_bytes), ranges_[s]});
}

Tensor FastExecutor::tensor(int node) const {
  const std::vector<std::pair<std::string, int>>& outputs = graph_.outputs();
  const bool is_output =
      std::any_of(outputs.begin(), outputs.end(), [&](const auto& output) { return output.second == node; });
  if (node < 0 || static_cast<std::size_t>(node) >= values_.size() || (!is_output && !keep_all_) ||
      values_[static_cast<std::size_t>(node)].empty() || workspace_->data() != memory_)
    throw Error(ErrorKind::kInternal, "the tensor of node " + std::to_string(node) + " was not kept");
  return values_[static_cast<std::size_t>(node)];
}

Tensor FastExecutor::tensor(std::string_view name) const {
  const std::optional<int> node = graph_.find(name);
  if (!node) throw Error(ErrorKind::kInternal, "the graph has no tensor named " + std::string(name));
  return tensor(*node);
}

}  // namespace slide
