#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "runtime/graph.h"
#include "runtime/plan.h"
#include "runtime/weights.h"

namespace slide {

/// What the steps of a plan read that does not depend on the inputs.
struct PlanConstants {
  std::vector<Tensor> values;                      ///< by node: F32 where Plan::needed, else empty
  std::vector<std::span<const std::byte>> packed;  ///< by step: what its kernel packed, if packed_once
  Tensor memory;                                   ///< holds all of `packed`
};

/// Folds in float64, rounds once to float32 and packs, step by step, several at a time. Large tensors are
/// folded some rows at a time where the operators allow it (Op::by_rows()), and what a step has read of the
/// weights is released as soon as it is packed: file, folded and packed weights are never in memory together.
/// `scratch` may be overwritten. Throws Error(kBadWeights) if the weights do not fit the graph.
[[nodiscard]] PlanConstants load_constants(const Graph& graph, const Plan& plan, const WeightSource& weights,
                                           std::span<std::byte> scratch);

/// The value of a constant node in float64, rounded to float32 as plans use it. Throws as load_constants().
[[nodiscard]] Tensor constant_value(const Graph& graph, const WeightSource& weights, int node);

}  // namespace slide
