#pragma once

#include <map>
#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "ops/fusion/fusion.h"
#include "runtime/graph.h"

namespace slide::ops {

/// A graph that is being rewritten: nodes can be given another operator and other inputs, which may be nodes
/// added later. What no result depends on is dead: it has no readers and no inputs.
class Draft {
 public:
  /// A copy of the graph. Its outputs, and its taps if they are to be kept, are results.
  Draft(const Graph& graph, const FusionOptions& options);

  /// Number of nodes, dead ones included.
  [[nodiscard]] int size() const noexcept { return static_cast<int>(nodes_.size()); }
  [[nodiscard]] const Node& node(int i) const { return nodes_.at(static_cast<std::size_t>(i)); }
  /// The node's operator if it is a live one of that class.
  template <typename T>
  [[nodiscard]] const T* as(int i) const {
    return node(i).kind == NodeKind::kOp && live(i) ? dynamic_cast<const T*>(node(i).op.get()) : nullptr;
  }
  [[nodiscard]] bool live(int i) const { return result(i) || !readers(i).empty(); }
  [[nodiscard]] bool result(int i) const { return result_.at(static_cast<std::size_t>(i)); }
  /// Depends on weights and constants only.
  [[nodiscard]] bool constant(int i) const { return constant_.at(static_cast<std::size_t>(i)); }
  /// The nodes that read node i; a node that reads it twice is there twice.
  [[nodiscard]] const std::vector<int>& readers(int i) const {
    return readers_.at(static_cast<std::size_t>(i));
  }
  /// Whether one node reads it, once, and it is no result.
  [[nodiscard]] bool read_once(int i) const { return !result(i) && readers(i).size() == 1; }

  /// Whether node i may become op(inputs): there is a kernel for it, or none is needed.
  [[nodiscard]] bool may_become(int i, const Op& op, const std::vector<int>& inputs) const;
  /// Node i becomes op(inputs), which must give the same shape.
  void replace(int i, std::shared_ptr<const Op> op, std::vector<int> inputs);
  /// Whoever reads node i reads `other`. Node i must be no result.
  void bypass(int i, int other);
  /// A new node op(inputs), named after node `owner` and the operator's type.
  int add(int owner, std::shared_ptr<const Op> op, const std::vector<int>& inputs);
  /// A new node of that value in every element, named after node `owner`.
  int add_constant(int owner, const Shape& shape, double value);

  /// The live nodes, each after its inputs and else in the old order; inputs and parameters live or not.
  [[nodiscard]] std::unique_ptr<Graph> graph() const;

 private:
  int append(int owner, std::string_view suffix, Node node);
  void set_inputs(int i, std::vector<int> inputs);
  void find_constant(int i);
  [[nodiscard]] std::vector<Shape> shapes_of(const std::vector<int>& nodes) const;

  bool need_kernels_;
  std::vector<Node> nodes_;
  std::vector<std::vector<int>> readers_;
  std::vector<bool> result_, constant_;
  std::set<std::string, std::less<>> names_;
  std::vector<std::pair<std::string, int>> outputs_;
  std::map<std::string, int, std::less<>> taps_;
};

}  // namespace slide::ops
