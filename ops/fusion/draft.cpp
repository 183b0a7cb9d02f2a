#include "ops/fusion/draft.h"

#include <algorithm>
#include <functional>

#include "ops/common/op_support.h"

namespace slide::ops {

Draft::Draft(const Graph& graph, const FusionOptions& options)
    : need_kernels_(options.need_kernels),
      nodes_(graph.nodes()),
      readers_(nodes_.size()),
      result_(nodes_.size()),
      constant_(nodes_.size()),
      outputs_(graph.outputs()),
      taps_(graph.taps()) {
  for (const auto& output : outputs_) result_[static_cast<std::size_t>(output.second)] = true;
  if (options.keep_taps)
    for (const auto& tap : taps_) result_[static_cast<std::size_t>(tap.second)] = true;
  for (int i = 0; i < size(); ++i) {
    names_.insert(node(i).name);
    for (const int j : node(i).inputs) readers_[static_cast<std::size_t>(j)].push_back(i);
    find_constant(i);
  }
  for (int i = size() - 1; i >= 0; --i)
    if (!live(i)) set_inputs(i, {});
}

void Draft::find_constant(int i) {
  const Node& n = node(i);
  const bool folds = n.kind == NodeKind::kOp && !n.inputs.empty() &&
                     std::all_of(n.inputs.begin(), n.inputs.end(), [&](int j) { return constant(j); });
  constant_[static_cast<std::size_t>(i)] =
      folds || n.kind == NodeKind::kParameter || n.kind == NodeKind::kConstant;
}

/// Inputs that lose their last reader die too.
void Draft::set_inputs(int i, std::vector<int> inputs) {
  for (const int j : inputs) readers_[static_cast<std::size_t>(j)].push_back(i);
  std::swap(nodes_[static_cast<std::size_t>(i)].inputs, inputs);
  for (const int j : inputs) {
    std::vector<int>& readers = readers_[static_cast<std::size_t>(j)];
    readers.erase(std::find(readers.begin(), readers.end(), i));
    if (!live(j)) set_inputs(j, {});
  }
}

std::vector<Shape> Draft::shapes_of(const std::vector<int>& nodes) const {
  std::vector<Shape> shapes;
  shapes.reserve(nodes.size());
  for (const int j : nodes) shapes.push_back(node(j).shape);
  return shapes;
}

bool Draft::may_become(int i, const Op& op, const std::vector<int>& inputs) const {
  const std::vector<Shape> shapes = shapes_of(inputs);
  return !need_kernels_ || std::ranges::any_of(op.kernels(), [&](const Kernel* kernel) {
    return kernel->isa() == Isa::kBaseline && kernel->precision() == Precision::kFp32 &&
           kernel->supports(op, shapes, node(i).shape);
  });
}

void Draft::replace(int i, std::shared_ptr<const Op> op, std::vector<int> inputs) {
  require_shape(op->type(), op->infer(shapes_of(inputs)), node(i).shape);
  nodes_[static_cast<std::size_t>(i)].op = std::move(op);
  set_inputs(i, std::move(inputs));
}

void Draft::bypass(int i, int other) {
  const std::vector<int> readers = this->readers(i);
  for (const int reader : readers) {
    std::vector<int> inputs = node(reader).inputs;
    std::replace(inputs.begin(), inputs.end(), i, other);
    if (inputs != node(reader).inputs) set_inputs(reader, std::move(inputs));
  }
}

int Draft::append(int owner, std::string_view suffix, Node n) {
  const std::string base = node(owner).name + "." + std::string(suffix);
  n.name = base;
  for (int k = 2; !names_.insert(n.name).second; ++k) n.name = base + "_" + std::to_string(k);
  std::vector<int> inputs = std::move(n.inputs);
  n.inputs.clear();
  nodes_.push_back(std::move(n));
  readers_.emplace_back();
  result_.push_back(false);
  constant_.push_back(false);
  set_inputs(size() - 1, std::move(inputs));
  find_constant(size() - 1);
  return size() - 1;
}

int Draft::add(int owner, std::shared_ptr<const Op> op, const std::vector<int>& inputs) {
  const Shape shape = op->infer(shapes_of(inputs));
  const std::string type(op->type());
  return append(owner, type, {NodeKind::kOp, {}, shape, std::move(op), inputs, {}});
}

int Draft::add_constant(int owner, const Shape& shape, double value) {
  Tensor tensor(DType::kF64, shape);
  std::ranges::fill(tensor.mutable_data<double>(), value);
  return append(owner, "constant", {NodeKind::kConstant, {}, shape, nullptr, {}, std::move(tensor)});
}

std::unique_ptr<Graph> Draft::graph() const {
  auto graph = std::make_unique<Graph>();
  std::vector<int> written(nodes_.size(), -1);
  const auto value = [&](int i) { return Value(*graph, written[static_cast<std::size_t>(i)]); };
  const std::function<void(int)> write = [&](int i) {
    if (written[static_cast<std::size_t>(i)] >= 0) return;
    const Node& n = node(i);
    std::vector<Value> inputs;
    for (const int j : n.inputs) {
      write(j);
      inputs.push_back(value(j));
    }
    const auto add = [&] {
      if (n.kind == NodeKind::kInput) return graph->input(n.name, n.shape);
      if (n.kind == NodeKind::kParameter) return graph->parameter(n.name, n.shape);
      if (n.kind == NodeKind::kConstant) return graph->constant(n.name, n.constant);
      return graph->add(n.op, inputs, n.name);
    };
    written[static_cast<std::size_t>(i)] = add().node();
  };
  for (int i = 0; i < size(); ++i)
    if (live(i) || node(i).kind == NodeKind::kInput || node(i).kind == NodeKind::kParameter) write(i);
  for (const auto& [name, i] : outputs_) graph->output(name, value(i));
  for (const auto& [name, i] : taps_)
    if (written[static_cast<std::size_t>(i)] >= 0) graph->tap(name, value(i));
  return graph;
}

}  // namespace slide::ops
