#include "runtime/reference_executor.h"

#include <chrono>

#include "runtime/error.h"
#include "runtime/lifetime.h"

namespace slide {

ReferenceExecutor::ReferenceExecutor(const Graph& graph, const WeightSource& weights)
    : graph_(graph), parameters_(bind(graph, weights)) {}

void ReferenceExecutor::run(const NamedTensors& inputs, const std::set<std::string>& keep, bool keep_all,
                            const RunOptions& options) {
  const std::vector<Node>& nodes = graph_.nodes();
  const int total = static_cast<int>(nodes.size());
  std::vector<int> last = last_uses(graph_);
  for (const std::string& name : keep) {
    const std::optional<int> node = graph_.find(name);
    if (!node) throw Error(ErrorKind::kInternal, "the graph has no tensor named " + name);
    last[static_cast<std::size_t>(*node)] = total;
  }
  results_.assign(nodes.size(), {});
  for (int i = 0; i < total; ++i) {
    const Node& node = nodes[static_cast<std::size_t>(i)];
    Tensor& result = results_[static_cast<std::size_t>(i)];
    if (options.progress && !options.progress({i, total, node.name}))
      throw Error(ErrorKind::kCancelled, "cancelled before layer " + node.name);
    switch (node.kind) {
      case NodeKind::kInput:
        result = checked_input(node, inputs).to(DType::kF64);
        break;
      case NodeKind::kParameter:
        break;  // widened where used
      case NodeKind::kConstant:
        result = node.constant;
        break;
      case NodeKind::kOp: {
        std::vector<Tensor> arguments;
        double bytes = static_cast<double>(node.shape.count()) * sizeof(double);
        std::vector<Shape> shapes;
        for (const int j : node.inputs) {
          const auto parameter = parameters_.find(j);
          arguments.push_back(parameter != parameters_.end() ? parameter->second.to(DType::kF64)
                                                             : results_[static_cast<std::size_t>(j)]);
          shapes.push_back(arguments.back().shape());
          bytes += static_cast<double>(arguments.back().bytes());
        }
        result = Tensor(DType::kF64, node.shape);
        const auto start = std::chrono::steady_clock::now();
        node.op->reference(arguments, result);
        const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
        if (options.profile != nullptr)
          options.profile->push_back(
              {node.name, "reference", took.count(), node.op->macs(shapes, node.shape), bytes});
        break;
      }
    }
    if (keep_all) continue;
    for (const int j : node.inputs)
      if (last[static_cast<std::size_t>(j)] == i) results_[static_cast<std::size_t>(j)] = {};
  }
}

const Tensor& ReferenceExecutor::tensor(int node) const {
  if (node < 0 || static_cast<std::size_t>(node) >= results_.size() ||
      results_[static_cast<std::size_t>(node)].empty())
    throw Error(ErrorKind::kInternal, "the tensor of node " + std::to_string(node) + " was not kept");
  return results_[static_cast<std::size_t>(node)];
}

const Tensor& ReferenceExecutor::tensor(std::string_view name) const {
  const std::optional<int> node = graph_.find(name);
  if (!node) throw Error(ErrorKind::kInternal, "the graph has no tensor named " + std::string(name));
  return tensor(*node);
}

}  // namespace slide
