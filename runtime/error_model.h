#pragma once

#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "runtime/graph.h"
#include "runtime/precision.h"

namespace slide {

// Errors here are root mean squares relative to the root mean square of the tensor they are in.
//
// The model: every kernel adds an error of its own (Kernel::expected_error()); errors of different nodes are
// independent; a node hands on the relative error of its input unchanged (gain 1), and a sum of independent
// terms of equal size takes over their squares divided by the number of terms (Op::error_share()). So the
// squared error of a graph's output is the sum of the nodes' squared errors, each times its share there.
// Networks amplify or dampen errors; calibration measures what each node of 8-bit integers does to the
// outputs. What a kernel adds by itself is more where its sums cancel, which weights tell
// (runtime/sensitivity.h). docs/precision.md has predictions beside measurements.

/// By node: which part of its squared relative error arrives at the output of the graph where that is
/// largest. 0 for nodes marked `constant` and those no output depends on.
[[nodiscard]] std::vector<double> error_shares(const Graph& graph, const std::vector<bool>& constant);

/// By node: whether it belongs to the ends of a network, which a plan of 8-bit integers keeps in float32:
/// of the nodes marked `low` (there is a kernel of that precision) those that no other comes before, and
/// those that no other comes behind on some way to an output. If that is all of them the network has no ends,
/// and none is marked.
[[nodiscard]] std::vector<bool> network_ends(const Graph& graph, const std::vector<bool>& low);

/// One way to compute a node.
struct KernelChoice {
  const Kernel* kernel;
  double square;  ///< what its error adds to the squared error of the output
  double cost;    ///< Kernel::cost()
};

/// Chooses one of each node's choices (at least one each) so that the squares add up to at most `limit` and
/// the costs to little: beginning with the smallest squares, the choice that saves the most for each square
/// it adds is taken as long as one fits. The result is the index for each node. If the smallest squares are
/// over the limit they are the result. Deterministic.
[[nodiscard]] std::vector<std::size_t> choose_within(std::span<const std::vector<KernelChoice>> choices,
                                                     double limit);

/// The budget of the precision "auto", and what a user may ask for.
inline constexpr double kDefaultErrorBudget = 1e-2;
inline constexpr double kLeastErrorBudget = 1e-7;
inline constexpr double kLargestErrorBudget = 1;

/// What users say about precision, as plans take it: see PlanOptions.
struct PrecisionChoice {
  Precision precision = Precision::kFp32;
  double error_budget = 0;
};

/// From "fp32", "bf16", "int8", "auto" or "", and perhaps a budget. "auto" is all precisions within the
/// budget (kDefaultErrorBudget if there is none); "" is "fp32", with a budget "auto". Throws Error(kUsage)
/// for anything else and for a budget outside of [kLeastErrorBudget, kLargestErrorBudget].
[[nodiscard]] PrecisionChoice precision_choice(std::string_view name, std::optional<double> error_budget);

/// Calibrated errors count for so many times what was measured: photos differ, and errors are not quite
/// independent.
inline constexpr double kCalibrationMargin = 1.5;

/// What calibrated plans of 8-bit integers and of bfloat16 without a budget are expected to add up to, at
/// most.
inline constexpr double kInt8Error = 1.5e-2;
inline constexpr double kBf16Error = 1e-2;

/// Part of its result that a layer below float32 may err by itself where its weights say so: beyond, sums
/// cancel until little is left.
inline constexpr double kLayerError = 0.05;

}  // namespace slide
