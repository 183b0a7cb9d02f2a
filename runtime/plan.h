#pragma once

#include <cstddef>
#include <vector>

#include "runtime/calibration.h"
#include "runtime/cpu.h"
#include "runtime/graph.h"
#include "runtime/weights.h"

namespace slide {

/// One computed node of a plan.
struct PlanStep {
  int node;
  const Kernel* kernel;
  std::size_t offset;          ///< of the result in the arena
  std::size_t scratch_offset;  ///< of the kernel's scratch memory in the arena
  std::size_t scratch_bytes;
  std::size_t packed_bytes;  ///< of the kernel's packed inputs, a multiple of 64
  bool packed_once;          ///< they are constant, packed before the first run; else in scratch, at each run
  double predicted_error;    ///< what the kernel adds to the error of the output (runtime/error_model.h)
  double sensitivity;        ///< find_sensitivities() where weights were given, else 1
  bool in_place;             ///< its inputs lie where the result has them: nothing is done (SharesStorage)
};

/// How a graph will be run: which nodes are constant and folded, which kernel computes each of the others,
/// and where every tensor lies in one arena.
struct Plan {
  std::vector<PlanStep> steps;
  std::vector<bool> constant;   ///< by node: depends on weights and constants only, computed once in float64
  std::vector<bool> needed;     ///< by node: a step reads its tensor when it runs, or it is an output
  std::size_t arena_bytes = 0;  ///< results and scratch memory
  std::size_t arena_lower_bound = 0;  ///< what no placement could undercut
  std::size_t weight_bytes = 0;       ///< weights and folded constants that the steps read, packed or float32
  Isa isa = Isa::kBaseline;
  /// Root mean square of the outputs' error relative to theirs, expected (runtime/error_model.h).
  double predicted_error = 0;

  /// Memory a run needs beside the caller's inputs.
  [[nodiscard]] std::size_t memory_bytes() const noexcept { return arena_bytes + weight_bytes; }
};

/// What a plan is made for.
struct PlanOptions {
  Isa isa = active_isa();
  bool keep_all = false;                   ///< no tensor's memory is used again: each can be looked at later
  Precision precision = Precision::kFp32;  ///< the lowest allowed
  double error_budget = 0;                 ///< predicted error allowed at the outputs; 0: no budget
  /// If not null, layers that it does not name are not computed in 8-bit integers, and the errors of those
  /// that it names are what it says.
  const Calibration* calibration = nullptr;
  /// If not null, and a precision below float32 is allowed without a calibration, what is predicted of errors
  /// follows from these weights (find_sensitivities()), and layers in which a kernel's own error is expected
  /// to be more than kLayerError of the result are computed in a higher precision.
  const WeightSource* weights = nullptr;
  /// Without a budget: no kernel of a precision between this one and float32, be it faster.
  bool only_precision = false;
};

/// Plans a graph. Reads weights only where PlanOptions::weights says so.
///
/// Without a budget each node gets the first kernel of the highest level not above `isa` that supports the
/// shapes and computes in `precision`, or replaces such a one (Kernel::replaces_lower()), else, or where that
/// is predicted to be faster, in float32. Of those below float32 the ones with the largest errors by the
/// calibration are computed in a higher precision, 8-bit integers in bfloat16 if that halves the square of
/// the error, until all together are expected to stay within kInt8Error or kBf16Error; what it does not know
/// is float32. Without calibration 8-bit integers leave the network's ends (network_ends()). With a budget
/// each node gets one of the kernels of `precision` and of all higher ones, so that the predicted error stays
/// within the budget and the predicted time is small (choose_within()).
///
/// Throws Error(kInternal) if an operator has no kernel for a node, Error(kUsage) if the most exact kernels
/// are predicted to be over the budget.
[[nodiscard]] Plan make_plan(const Graph& graph, const PlanOptions& options);
/// The same without a budget.
[[nodiscard]] Plan make_plan(const Graph& graph, Isa isa, bool keep_all = false,
                             Precision precision = Precision::kFp32);

}  // namespace slide
