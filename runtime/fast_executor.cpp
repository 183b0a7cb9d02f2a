#include "runtime/fast_executor.h"

#include <algorithm>
#include <chrono>

#include "runtime/error.h"
#include "runtime/lifetime.h"
#include "runtime/threads.h"

namespace slide {
namespace {

std::string mebibytes(std::size_t bytes) { return std::to_string((bytes + (1U << 20) - 1) >> 20) + " MiB"; }

/// Nodes whose value is only needed to fold others are dropped as soon as the last of those is done.
std::vector<int> last_fold_uses(const Graph& graph, const Plan& plan) {
  std::vector<int> last(graph.nodes().size(), -1);
  for (std::size_t i = 0; i < graph.nodes().size(); ++i)
    if (plan.constant[i])
      for (const int j : graph.nodes()[i].inputs) last[static_cast<std::size_t>(j)] = static_cast<int>(i);
  return last;
}

}  // namespace

FastExecutor::FastExecutor(const Graph& graph, const WeightSource& weights, const FastOptions& options)
    : graph_(graph), plan_(make_plan(graph, options.isa, options.keep_all)), keep_all_(options.keep_all) {
  if (options.memory_limit != 0 && plan_.memory_bytes() > options.memory_limit)
    throw Error(ErrorKind::kOutOfMemory,
                "the plan needs " + mebibytes(plan_.memory_bytes()) + " (" + mebibytes(plan_.arena_bytes) +
                    " of results, " + mebibytes(plan_.weight_bytes) +
                    " of weights), more than the limit of " + mebibytes(options.memory_limit),
                "allow more memory or use a smaller size");
  fold_constants(weights);
  arena_ = Tensor(DType::kU8, {static_cast<std::int64_t>(plan_.arena_bytes)});
  for (const PlanStep& step : plan_.steps)
    values_[static_cast<std::size_t>(step.node)] =
        Tensor::view(DType::kF32, graph_.node(step.node).shape, arena_.mutable_raw().data() + step.offset);
}

void FastExecutor::fold_constants(const WeightSource& weights) {
  const std::map<int, Tensor> parameters = bind(graph_, weights);
  const std::vector<int> last = last_fold_uses(graph_, plan_);
  values_.assign(graph_.nodes().size(), {});
  std::map<int, Tensor> folded;  // F64 results that later folds read
  const auto in_double = [&](int j) {
    if (const auto it = parameters.find(j); it != parameters.end()) return it->second.to(DType::kF64);
    return folded.at(j);
  };
  for (int i = 0; i < static_cast<int>(graph_.nodes().size()); ++i) {
    const std::size_t index = static_cast<std::size_t>(i);
    if (!plan_.constant[index]) continue;
    const Node& node = graph_.nodes()[index];
    if (node.kind == NodeKind::kParameter) {
      if (plan_.needed[index]) values_[index] = parameters.at(i).to(DType::kF32);
      continue;
    }
    Tensor result = node.constant;
    if (node.kind == NodeKind::kOp) {
      std::vector<Tensor> arguments;
      for (const int j : node.inputs) arguments.push_back(in_double(j));
      result = Tensor(DType::kF64, node.shape);
      node.op->reference(arguments, result);
    }
    if (plan_.needed[index]) values_[index] = result.to(DType::kF32);
    if (last[index] > i) folded.emplace(i, std::move(result));
    for (const int j : node.inputs)
      if (last[static_cast<std::size_t>(j)] == i) folded.erase(j);
  }
}

void FastExecutor::run(const NamedTensors& inputs, const RunOptions& options) {
  const FlushDenormals flush;
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
    std::vector<Shape> shapes;
    Tensor& result = values_[static_cast<std::size_t>(step.node)];
    double bytes = static_cast<double>(result.bytes());
    for (const int j : node.inputs) {
      arguments.push_back(values_[static_cast<std::size_t>(j)]);
      shapes.push_back(arguments.back().shape());
      bytes += static_cast<double>(arguments.back().bytes());
    }
    const auto start = std::chrono::steady_clock::now();
    step.kernel->run(*node.op, arguments, result,
                     arena_.mutable_raw().subspan(step.scratch_offset, step.scratch_bytes));
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    if (options.profile != nullptr)
      options.profile->push_back(
          {node.name, std::string(step.kernel->name()) + "." + std::string(name_of(step.kernel->isa())),
           took.count(), node.op->macs(shapes, node.shape), bytes});
  }
}

Tensor FastExecutor::tensor(int node) const {
  const std::vector<std::pair<std::string, int>>& outputs = graph_.outputs();
  const bool is_output =
      std::any_of(outputs.begin(), outputs.end(), [&](const auto& output) { return output.second == node; });
  if (node < 0 || static_cast<std::size_t>(node) >= values_.size() || (!is_output && !keep_all_) ||
      values_[static_cast<std::size_t>(node)].empty())
    throw Error(ErrorKind::kInternal, "the tensor of node " + std::to_string(node) + " was not kept");
  return values_[static_cast<std::size_t>(node)];
}

Tensor FastExecutor::tensor(std::string_view name) const {
  const std::optional<int> node = graph_.find(name);
  if (!node) throw Error(ErrorKind::kInternal, "the graph has no tensor named " + std::string(name));
  return tensor(*node);
}

}  // namespace slide
