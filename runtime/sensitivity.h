#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "runtime/graph.h"
#include "runtime/weights.h"

namespace slide {

// What the weights say of a network's errors, without a run. Mean and variance of every channel are followed
// from the graph's inputs to its outputs, channels and positions taken as independent, and with them how much
// sums cancel: a filter whose weights add up to zero leaves little of a large mean but all of its roundings.

/// What a tensor's values are expected to be: by channel (index along the second axis), or one entry for
/// tensors of fewer axes.
struct ValueStatistics {
  std::vector<double> mean, variance;

  [[nodiscard]] std::size_t channels() const noexcept { return mean.size(); }
  /// Of channel c (of a single one: of that) the expected square.
  [[nodiscard]] double square(std::size_t c) const;
  /// Of all channels together, which count the same.
  [[nodiscard]] double square() const;
};

/// What an operator is told.
struct StatisticsCall {
  std::span<const ValueStatistics> inputs;  ///< of constants: empty
  std::span<const Tensor> constants;        ///< by input, F64; empty where that is computed at a run
  std::span<const Shape> shapes;            ///< of the inputs
};

/// How an operator treats values and errors.
struct NodeStatistics {
  ValueStatistics output;
  /// The square of how many times Kernel::expected_error() a kernel that rounds its operands errs, because the
  /// result is smaller than the root of the sum of its terms' squares.
  double own = 1;
};

/// What an operator implements beside Op if its results are not like its first input.
class StatesStatistics {
 public:
  StatesStatistics() = default;
  StatesStatistics(const StatesStatistics&) = default;
  StatesStatistics& operator=(const StatesStatistics&) = default;
  virtual ~StatesStatistics() = default;
  [[nodiscard]] virtual NodeStatistics statistics(const StatisticsCall& call) const = 0;
};

/// No sensitivity is larger: nothing of a result is left long before.
inline constexpr double kMostSensitive = 1e6;

/// By node: how many times its expected error a kernel that rounds its operands may make, at least 1. It is the
/// largest over the inputs that networks of images are to expect: a photo, whose channels are 0.5 ± 0.5 (in
/// [0, 1], or normalised, of order 1), and images of one colour, 1, -1 and 0. Folds the constants, so the
/// weights are read once. Throws Error(kBadWeights) if they do not fit the graph.
[[nodiscard]] std::vector<double> find_sensitivities(const Graph& graph, const std::vector<bool>& constant,
                                                     const WeightSource& weights);

/// Mean and variance of a constant's elements.
[[nodiscard]] ValueStatistics statistics_of(const Tensor& constant);

/// What holds of an operator that nothing else is known of: the result is like its first computed input, whose
/// channels are averaged if it has other ones.
[[nodiscard]] NodeStatistics handed_on(const Op& op, const StatisticsCall& call);

/// error / size, both squares: at most kMostSensitive², 0 for no error.
[[nodiscard]] double relative_square(double error, double size) noexcept;

}  // namespace slide
