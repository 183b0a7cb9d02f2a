#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "runtime/op.h"
#include "runtime/shape.h"
#include "runtime/tensor.h"

namespace slide {

class Graph;

/// A handle to the one tensor that a node makes. Cheap to copy; valid as long as its Graph.
class Value {
 public:
  Value(Graph& graph, int node) : graph_(&graph), node_(node) {}
  [[nodiscard]] Graph& graph() const noexcept { return *graph_; }
  [[nodiscard]] int node() const noexcept { return node_; }
  [[nodiscard]] const Shape& shape() const;

 private:
  Graph* graph_;
  int node_;
};

enum class NodeKind {
  kInput,      ///< given at each run
  kParameter,  ///< comes from the weights
  kConstant,   ///< fixed when the graph is built
  kOp,         ///< computed
};

struct Node {
  NodeKind kind;
  std::string name;              ///< unique in the graph
  Shape shape;                   ///< of the tensor it makes
  std::shared_ptr<const Op> op;  ///< kOp only
  std::vector<int> inputs;       ///< indices of earlier nodes
  Tensor constant;               ///< kConstant only; F64
};

/// A static directed acyclic graph of tensor operations, built by calling functions (ops/*). Nodes are in the
/// order in which they were added, which is an order they can run in. Shapes are known and checked as each
/// node is added.
class Graph {
 public:
  Graph() = default;
  Graph(const Graph&) = delete;
  Graph& operator=(const Graph&) = delete;

  /// While it lives, names given to the graph are prefixed with "name." (nested scopes join with dots).
  class Scope {
   public:
    Scope(Graph& graph, std::string_view name);
    ~Scope();
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;

   private:
    Graph& graph_;
    std::size_t saved_length_;
  };
  [[nodiscard]] Scope scope(std::string_view name) { return {*this, name}; }

  /// A tensor the caller gives at each run. Throws Error(kInternal) if the name is taken.
  Value input(std::string_view name, const Shape& shape);
  /// A weight, by the authors' own parameter name. Asking twice for one name gives the same node; throws
  /// Error(kInternal) if the shapes then differ.
  Value parameter(std::string_view name, const Shape& shape);
  /// A fixed F64 tensor.
  Value constant(std::string_view name, const Tensor& value);
  /// The result of an operator. The node is named after the scope and the operator's type, numbered if
  /// needed. Throws Error(kInternal) naming the layer and the shapes that do not fit.
  Value add(std::shared_ptr<const Op> op, const std::vector<Value>& inputs);
  /// The same with a name of its own, prefixed by the scope. Throws Error(kInternal) too if it is taken.
  Value add(std::shared_ptr<const Op> op, const std::vector<Value>& inputs, std::string_view name);

  /// Declares a result of the graph, under a name (not prefixed by the scope).
  void output(std::string_view name, Value value);
  /// Gives a value a second name by which tools can find it: the authors' module that makes it. Prefixed by
  /// the scope.
  void tap(std::string_view name, Value value);

  [[nodiscard]] const std::vector<Node>& nodes() const noexcept { return nodes_; }
  [[nodiscard]] const Node& node(int index) const { return nodes_.at(static_cast<std::size_t>(index)); }
  /// Name and node of each output, in the order declared.
  [[nodiscard]] const std::vector<std::pair<std::string, int>>& outputs() const noexcept { return outputs_; }
  [[nodiscard]] const std::map<std::string, int, std::less<>>& taps() const noexcept { return taps_; }
  /// The node of an output, a tap or a node name, looked for in this order.
  [[nodiscard]] std::optional<int> find(std::string_view name) const;

 private:
  friend class Scope;
  [[nodiscard]] std::string full(std::string_view name) const;
  Value append(Node node);
  Value append_op(std::shared_ptr<const Op> op, const std::vector<Value>& inputs, std::string name);

  std::vector<Node> nodes_;
  std::map<std::string, int, std::less<>> by_name_;
  std::map<std::string, int, std::less<>> taps_;
  std::vector<std::pair<std::string, int>> outputs_;
  std::string prefix_;  // "a.b." or empty
};

}  // namespace slide
