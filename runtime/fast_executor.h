#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "runtime/constants.h"
#include "runtime/graph.h"
#include "runtime/plan.h"
#include "runtime/run.h"
#include "runtime/weights.h"
#include "runtime/workspace.h"

namespace slide {

/// What a FastExecutor may be told.
struct FastOptions {
  Isa isa = active_isa();
  bool keep_all = false;                     ///< every node's tensor can be looked at after a run
  std::size_t memory_limit = 0;              ///< bytes for arena and weights; 0 = no limit
  Precision precision = Precision::kFp32;    ///< as in PlanOptions
  double error_budget = 0;                   ///< as in PlanOptions
  const Calibration* calibration = nullptr;  ///< as in PlanOptions; null: that of the weights
  bool only_precision = false;               ///< as in PlanOptions
  /// Where results lie; may be shared with other executors, of which one runs at a time. Null: own memory.
  std::shared_ptr<Workspace> workspace = nullptr;
};

/// Runs a graph's plan: constants folded once in float64 and packed once, one kernel a node, all results in
/// one arena.
class FastExecutor {
 public:
  /// Plans, checks the memory limit, binds and folds the weights. Throws Error(kOutOfMemory) naming what is
  /// needed if that is over the limit (before anything is allocated), Error(kBadWeights) if the weights do
  /// not fit. The graph must outlive the executor.
  FastExecutor(const Graph& graph, const WeightSource& weights, const FastOptions& options = {});

  /// Runs the graph. Inputs of another floating dtype are converted to float32. Denormals are flushed to zero
  /// meanwhile. Throws Error(kInternal) for a missing input or one of a wrong shape, Error(kCancelled) if the
  /// callback says so.
  void run(const NamedTensors& inputs, const RunOptions& options = {});

  /// The F32 tensor of an output of the last run; with keep_all of any tap or node. It lies in the workspace
  /// and is overwritten by the next run of whoever shares that. Throws Error(kInternal) if there is no such
  /// tensor or its memory was used again.
  [[nodiscard]] Tensor tensor(std::string_view name) const;
  [[nodiscard]] Tensor tensor(int node) const;

  [[nodiscard]] const Plan& plan() const noexcept { return plan_; }

 private:
  /// Results are views of the workspace, which may have been given back or enlarged since the last run.
  void bind_results();
  void run_step(std::size_t step, std::span<const Tensor> inputs, std::span<const Shape> shapes,
                Tensor& result);

  const Graph& graph_;
  Plan plan_;
  bool keep_all_;
  std::shared_ptr<Workspace> workspace_;
  std::byte* memory_ = nullptr;               // of the workspace, as the results are bound to it
  PlanConstants constants_;                   // but for its values, which go to values_
  std::vector<Tensor> values_;                // by node: constants, inputs, results as views of the workspace
  std::vector<std::optional<Range>> ranges_;  // by step: of its first input
};

}  // namespace slide
