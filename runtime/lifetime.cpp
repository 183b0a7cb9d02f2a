#include "runtime/lifetime.h"

#include "runtime/error.h"

namespace slide {

std::vector<int> last_uses(const Graph& graph) {
  const int total = static_cast<int>(graph.nodes().size());
  std::vector<int> last(static_cast<std::size_t>(total));
  for (int i = 0; i < total; ++i) {
    last[static_cast<std::size_t>(i)] = i;
    for (const int j : graph.node(i).inputs) last[static_cast<std::size_t>(j)] = i;
  }
  for (const auto& output : graph.outputs()) last[static_cast<std::size_t>(output.second)] = total;
  return last;
}

std::vector<Shape> input_shapes(const Graph& graph, const Node& node) {
  std::vector<Shape> shapes;
  shapes.reserve(node.inputs.size());
  for (const int j : node.inputs) shapes.push_back(graph.node(j).shape);
  return shapes;
}

const Tensor& checked_input(const Node& node, const NamedTensors& inputs) {
  const auto it = inputs.find(node.name);
  if (it == inputs.end()) throw Error(ErrorKind::kInternal, "the input " + node.name + " was not given");
  if (it->second.shape() != node.shape)
    throw Error(ErrorKind::kInternal, "the input " + node.name + " has the shape " +
                                          it->second.shape().text() + ", the graph was built for " +
                                          node.shape.text());
  return it->second;
}

}  // namespace slide
