#include "graphs/compare.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <map>

#include "ops/case_io.h"
#include "ops/case_of.h"
#include "ops/fusion/fusion.h"
#include "runtime/error.h"
#include "runtime/fast_executor.h"
#include "runtime/lifetime.h"
#include "runtime/own_file.h"

namespace slide::graphs {
namespace {

/// A file name for a node: its index, so that names sort in the order of the run, and its name.
std::string case_path(const std::string& folder, int index, const std::string& name) {
  std::string number = std::to_string(index);
  number.insert(0, number.size() < 4 ? 4 - number.size() : 0, '0');
  std::string safe = name;
  for (char& c : safe)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '.' && c != '_' && c != '-') c = '_';
  return (std::filesystem::path(folder) / (number + "_" + safe + ".safetensors")).string();
}

void make_folder(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error) throw Error(ErrorKind::kOutput, path + ": cannot make the folder: " + error.message());
}

/// What a node's case says about its source.
std::string source_of(const Node& node, const CompareOptions& options) {
  return options.source.empty() ? node.name : options.source + " " + node.name;
}

/// Refuses to replace what is no earlier case of the same node.
void require_own_case(const Node& node, int index, const CompareOptions& options) {
  require_own_file(case_path(options.dump_folder, index, node.name), [&](const std::string& path) {
    try {
      return ops::read_case(path).source == source_of(node, options);
    } catch (const Error& e) {
      if (e.kind() != ErrorKind::kBadInput) throw;
      return false;
    }
  });
}

/// The float64 values of a graph, computed one after the other and dropped after their last use.
class Walk {
 public:
  Walk(const Graph& graph, const WeightSource& weights, const NamedTensors& inputs)
      : graph_(graph), inputs_(inputs), parameters_(bind(graph, weights)), last_(last_uses(graph)) {}

  /// The float64 inputs of a node; call in the order of the nodes.
  [[nodiscard]] std::vector<Tensor> arguments(const Node& node) const {
    std::vector<Tensor> result;
    for (const int j : node.inputs) {
      const auto parameter = parameters_.find(j);
      result.push_back(parameter != parameters_.end() ? parameter->second.to(DType::kF64) : values_.at(j));
    }
    return result;
  }
  /// The value of node i, which is kept for those that read it.
  Tensor compute(int i, std::span<const Tensor> arguments) {
    const Node& node = graph_.node(i);
    Tensor value = node.constant;
    if (node.kind == NodeKind::kInput) value = checked_input(node, inputs_).to(DType::kF64);
    if (node.kind == NodeKind::kOp) {
      value = Tensor(DType::kF64, node.shape);
      node.op->reference(arguments, value);
    }
    values_[i] = value;
    return value;
  }
  /// Drops what no node after i reads.
  void drop_after(int i) {
    for (const int j : graph_.node(i).inputs)
      if (last_[static_cast<std::size_t>(j)] == i) values_.erase(j);
    if (last_[static_cast<std::size_t>(i)] == i) values_.erase(i);
  }

 private:
  const Graph& graph_;
  const NamedTensors& inputs_;
  std::map<int, Tensor> parameters_;
  std::vector<int> last_;
  std::map<int, Tensor> values_;
};

/// Checks a node's kernel alone and, if wanted, writes the call as a case.
ops::KernelCheck check_local(const Node& node, int index, const Kernel& kernel,
                             std::span<const Tensor> arguments, const CompareOptions& options) {
  const ops::KernelTask task = ops::make_task(*node.op, arguments);
  ops::KernelCheck check = ops::check_kernel(kernel, task);
  check.output = {};
  if (!options.dump_folder.empty()) {
    ops::OperatorCase c = ops::case_of(*node.op, task.inputs, task.reference);
    c.source = source_of(node, options);
    ops::write_case(case_path(options.dump_folder, index, node.name), c);
  }
  return check;
}

/// The fused graph's outputs against those of the reference, by node of the graph as it was built.
std::vector<OutputComparison> compare_fused(const Graph& graph, const WeightSource& weights,
                                            const NamedTensors& inputs, const CompareOptions& options,
                                            const std::map<int, Tensor>& outputs) {
  const std::unique_ptr<Graph> fused = ops::fuse(graph);
  FastExecutor fast(
      *fused, weights,
      {.isa = options.isa, .precision = options.precision, .error_budget = options.error_budget});
  fast.run(inputs);
  std::vector<OutputComparison> result;
  for (const auto& [name, node] : graph.outputs())
    result.push_back({name, tensor_error(fast.tensor(name), outputs.at(node)), fast.plan().predicted_error});
  return result;
}

}  // namespace

TensorError tensor_error(const Tensor& a, const Tensor& b) {
  TensorError error;
  error.max = ops::relative_error(a, b);
  if (!std::isfinite(error.max)) return {error.max, error.max};
  const Tensor a64 = a.to(DType::kF64);
  const Tensor b64 = b.to(DType::kF64);
  const std::span<const double> x = a64.data<double>();
  const std::span<const double> y = b64.data<double>();
  double square = 0;
  double norm = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (!std::isfinite(y[i])) continue;  // equal in both, or the maximum were infinite
    square += (x[i] - y[i]) * (x[i] - y[i]);
    norm += y[i] * y[i];
  }
  error.rms = square == 0 ? 0 : std::sqrt(square / norm);
  return error;
}

bool Comparison::passed() const noexcept {
  return std::all_of(nodes.begin(), nodes.end(), [](const NodeComparison& n) { return n.local.passed(); });
}

Comparison compare(const Graph& graph, const WeightSource& weights, const NamedTensors& inputs,
                   const CompareOptions& options) {
  FastExecutor fast(graph, weights,
                    {.isa = options.isa,
                     .keep_all = true,
                     .precision = options.precision,
                     .error_budget = options.error_budget});
  if (!options.dump_folder.empty()) {
    make_folder(options.dump_folder);
    for (const PlanStep& step : fast.plan().steps)
      if (!options.overwrite) require_own_case(graph.node(step.node), step.node, options);
  }
  fast.run(inputs);
  std::map<int, const Kernel*> kernels;
  for (const PlanStep& step : fast.plan().steps) kernels[step.node] = step.kernel;

  Comparison result;
  result.isa = options.isa;
  Walk walk(graph, weights, inputs);
  std::map<int, Tensor> outputs;
  for (const auto& output : graph.outputs()) outputs[output.second];
  const int total = static_cast<int>(graph.nodes().size());
  for (int i = 0; i < total; ++i) {
    const Node& node = graph.node(i);
    if (node.kind == NodeKind::kParameter) continue;
    if (options.progress && !options.progress({i, total, node.name}))
      throw Error(ErrorKind::kCancelled, "cancelled before layer " + node.name);
    const std::vector<Tensor> arguments = walk.arguments(node);
    const Tensor reference = walk.compute(i, arguments);
    if (const auto output = outputs.find(i); output != outputs.end()) output->second = reference;
    if (node.kind == NodeKind::kOp) {
      const auto kernel = kernels.find(i);
      const Tensor fast_tensor = kernel == kernels.end() ? Tensor() : fast.tensor(i);
      if (kernel != kernels.end()) {
        result.nodes.push_back({i, node.name, std::string(node.op->type()), node.op->attributes(), node.shape,
                                tensor_error(fast_tensor, reference), kernel->second->precision(),
                                check_local(node, i, *kernel->second, arguments, options)});
        if (!options.dump_folder.empty()) ++result.dumped;
      }
      if (options.visit) options.visit(i, reference, fast_tensor);
    }
    walk.drop_after(i);
  }
  if (options.fused) result.fused = compare_fused(graph, weights, inputs, options, outputs);
  return result;
}

}  // namespace slide::graphs
