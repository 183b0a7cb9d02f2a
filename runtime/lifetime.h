#pragma once

#include <vector>

#include "runtime/graph.h"
#include "runtime/run.h"

namespace slide {

/// For each node the index of the last node that reads it; the number of nodes for outputs, which live on;
/// the node's own index if nothing reads it.
[[nodiscard]] std::vector<int> last_uses(const Graph& graph);

/// The shapes of a node's inputs.
[[nodiscard]] std::vector<Shape> input_shapes(const Graph& graph, const Node& node);

/// The caller's tensor for an input node. Throws Error(kInternal) if it is missing or its shape is not the
/// declared one.
[[nodiscard]] const Tensor& checked_input(const Node& node, const NamedTensors& inputs);

}  // namespace slide
