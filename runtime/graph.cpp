#include "runtime/graph.h"

#include "runtime/error.h"

namespace slide {

const Shape& Value::shape() const { return graph_->node(node_).shape; }

Graph::Scope::Scope(Graph& graph, std::string_view name)
    : graph_(graph), saved_length_(graph.prefix_.size()) {
  graph.prefix_.append(name).push_back('.');
}

Graph::Scope::~Scope() { graph_.prefix_.resize(saved_length_); }

std::string Graph::full(std::string_view name) const { return prefix_ + std::string(name); }

Value Graph::append(Node node) {
  const int index = static_cast<int>(nodes_.size());
  if (!by_name_.emplace(node.name, index).second)
    throw Error(ErrorKind::kInternal, "the graph already has a node named " + node.name);
  nodes_.push_back(std::move(node));
  return {*this, index};
}

Value Graph::input(std::string_view name, const Shape& shape) {
  return append({NodeKind::kInput, full(name), shape, nullptr, {}, {}});
}

Value Graph::parameter(std::string_view name, const Shape& shape) {
  const auto known = by_name_.find(full(name));
  if (known == by_name_.end()) return append({NodeKind::kParameter, full(name), shape, nullptr, {}, {}});
  const Node& node = nodes_[static_cast<std::size_t>(known->second)];
  if (node.kind != NodeKind::kParameter || node.shape != shape)
    throw Error(ErrorKind::kInternal, "the parameter " + full(name) + " was declared as " +
                                          node.shape.text() + " and is now asked for as " + shape.text());
  return {*this, known->second};
}

Value Graph::constant(std::string_view name, const Tensor& value) {
  const Shape shape = value.shape();
  return append({NodeKind::kConstant, full(name), shape, nullptr, {}, value.to(DType::kF64)});
}

Value Graph::add(std::shared_ptr<const Op> op, const std::vector<Value>& inputs) {
  const std::string base = full(op->type());
  std::string name = base;
  for (int i = 2; by_name_.contains(name); ++i) name = base + "_" + std::to_string(i);
  return append_op(std::move(op), inputs, std::move(name));
}

Value Graph::add(std::shared_ptr<const Op> op, const std::vector<Value>& inputs, std::string_view name) {
  return append_op(std::move(op), inputs, full(name));
}

Value Graph::append_op(std::shared_ptr<const Op> op, const std::vector<Value>& inputs, std::string name) {
  std::vector<Shape> shapes;
  std::vector<int> indices;
  for (const Value& v : inputs) {
    if (&v.graph() != this)
      throw Error(ErrorKind::kInternal, "layer " + name + ": an input is of another graph");
    shapes.push_back(v.shape());
    indices.push_back(v.node());
  }
  Shape shape;
  try {
    shape = op->infer(shapes);
  } catch (const Error& e) {
    throw Error(e.kind(), "layer " + name + ": " + e.what());
  }
  return append({NodeKind::kOp, std::move(name), shape, std::move(op), std::move(indices), {}});
}

void Graph::output(std::string_view name, Value value) {
  outputs_.emplace_back(std::string(name), value.node());
}

void Graph::tap(std::string_view name, Value value) {
  if (!taps_.emplace(full(name), value.node()).second)
    throw Error(ErrorKind::kInternal, "the graph already has a tap named " + full(name));
}

std::optional<int> Graph::find(std::string_view name) const {
  for (const auto& [output_name, node] : outputs_)
    if (output_name == name) return node;
  if (const auto tap = taps_.find(name); tap != taps_.end()) return tap->second;
  if (const auto node = by_name_.find(name); node != by_name_.end()) return node->second;
  return std::nullopt;
}

}  // namespace slide
