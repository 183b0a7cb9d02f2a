#pragma once

#include <functional>
#include <string>
#include <vector>

#include "ops/check.h"
#include "runtime/graph.h"
#include "runtime/precision.h"
#include "runtime/run.h"
#include "runtime/weights.h"

namespace slide::graphs {

/// How far one tensor is from another: max |a - b| / max |b|, and the root mean square of a - b divided by
/// that of b. Infinite if a NaN or an infinity stands against anything else.
struct TensorError {
  double max = 0;
  double rms = 0;
};
[[nodiscard]] TensorError tensor_error(const Tensor& a, const Tensor& b);

/// One node of a fast run beside the float64 reference.
struct NodeComparison {
  int node = 0;
  std::string name;
  std::string type;
  std::string attributes;
  Shape shape;
  /// The fast executor's tensor after a run from the graph's inputs, against that of the reference: what all
  /// nodes before it have added up.
  TensorError accumulated;
  Precision precision = Precision::kFp32;  ///< of the node's kernel
  /// The node's kernel alone, on the reference's inputs rounded to float32, in units of its bound. The
  /// tensors are left out.
  ops::KernelCheck local;
};

/// One output of the plan that real runs use, of the fused graph, against the float64 reference of the graph
/// as it was built.
struct OutputComparison {
  std::string name;
  TensorError error;
  double predicted = 0;  ///< root mean square that the plan expects (Plan::predicted_error)
};

/// What compare() may be told.
struct CompareOptions {
  Isa isa = active_isa();
  /// Where to write every computed node as an operator case (see ops/case_io.h): inputs in float32, expected
  /// output in float64. Nothing is written if it is empty; the folder is made if it is missing.
  std::string dump_folder{};
  /// Replace existing files there, too, that are not cases of the same source and node.
  bool overwrite = false;
  /// What the cases say about their source, beside the node's name.
  std::string source{};
  /// Run the fused graph too (ops/fusion/fusion.h) and compare its outputs.
  bool fused = false;
  /// Of both plans, as in PlanOptions: each node is judged in the precision that the plan of the graph as it
  /// was built computes it in. Ranges are measured for that, be the layer calibrated or not.
  Precision precision = Precision::kFp32;
  double error_budget = 0;
  /// Called before each node; returning false ends with Error(kCancelled).
  ProgressCallback progress{};
  /// Called with every computed node's tensors: float64 reference, and fast, which is empty where the plan
  /// has folded the node into the weights.
  std::function<void(int node, const Tensor& reference, const Tensor& fast)> visit{};
};

/// A fast run beside the float64 reference, in the order of the graph.
struct Comparison {
  Isa isa = Isa::kBaseline;
  std::vector<NodeComparison> nodes;
  std::vector<OutputComparison> fused;  ///< the graph's outputs, if asked for
  int dumped = 0;                       ///< case files written
  /// Every node's kernel is within its stated bound. Since a node's error then is a stated multiple of the
  /// roundoff, what is added up at the outputs is the network's own conditioning, and is reported without a
  /// bound.
  [[nodiscard]] bool passed() const noexcept;
};

/// Runs the graph with the fast executor and, node by node, in float64 (and each kernel once more on the
/// reference's inputs); if asked for, the fused graph beside it. Float64 tensors are dropped after their last
/// use; the fast executor keeps all of its own. Throws what both executors throw.
[[nodiscard]] Comparison compare(const Graph& graph, const WeightSource& weights, const NamedTensors& inputs,
                                 const CompareOptions& options = {});

}  // namespace slide::graphs
