#pragma once

#include <set>
#include <string>

#include "runtime/graph.h"
#include "runtime/run.h"
#include "runtime/weights.h"

namespace slide {

/// Runs every node of a graph in float64 with its operator's definition, one after the other. It is the judge
/// of all fast kernels. Weights are widened to float64 as they are used, and results are dropped after their
/// last use unless they are to be kept.
class ReferenceExecutor {
 public:
  /// Binds the weights. Throws Error(kBadWeights) if they do not fit. The graph must outlive the executor.
  ReferenceExecutor(const Graph& graph, const WeightSource& weights);

  /// Runs the graph. `keep` names outputs, taps or nodes whose tensors tensor() can hand out afterwards;
  /// outputs are always kept. With `keep_all` every node's is. Inputs may be of any floating dtype;
  /// Error(kInternal) if one is missing or has another shape than declared.
  void run(const NamedTensors& inputs, const std::set<std::string>& keep = {}, bool keep_all = false,
           const RunOptions& options = {});

  /// The F64 tensor of an output, tap or node of the last run. Throws Error(kInternal) if it was not kept.
  [[nodiscard]] const Tensor& tensor(std::string_view name) const;
  [[nodiscard]] const Tensor& tensor(int node) const;

 private:
  const Graph& graph_;
  std::map<int, Tensor> parameters_;
  std::vector<Tensor> results_;
};

}  // namespace slide
