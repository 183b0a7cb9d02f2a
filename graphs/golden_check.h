#pragma once

#include <string>
#include <vector>

#include "graphs/compare.h"
#include "graphs/golden.h"

namespace slide::graphs {

/// One output or intermediate tensor of a golden run.
struct GoldenTensorCheck {
  std::string name;
  bool output = false;
  double reference_error =
      0;                 ///< of the float64 executor against the golden tensor, as part of its magnitude
  double tolerance = 0;  ///< for it: kGoldenOutput or kGoldenTap
  TensorError fast;      ///< of the fast executor against the float64 one
  [[nodiscard]] bool passed() const noexcept { return reference_error <= tolerance; }
};

/// What the float64 reference may differ from a golden run, as part of the tensor's largest magnitude:
/// outputs are stored in float64, intermediate tensors in float32.
inline constexpr double kGoldenOutput = 1e-9;
inline constexpr double kGoldenTap = 1e-6;

/// A golden run beside both executors.
struct GoldenCheck {
  std::string network;
  std::string golden;   ///< what messages call the golden file
  std::string weights;  ///< and the weights
  std::vector<GoldenTensorCheck> tensors;
  Comparison comparison;  ///< fast against float64, node by node
  /// The reference is within its tolerances and every kernel is within its bound.
  [[nodiscard]] bool passed() const noexcept;
};

/// Runs the golden's network on the golden's inputs. `options.visit` is not used. Throws what Golden and
/// compare() throw, Error(kBadInput) too if a tensor of the golden file is an input or a weight.
[[nodiscard]] GoldenCheck check_golden(const Golden& golden, const WeightSource& weights,
                                       const CompareOptions& options = {});

}  // namespace slide::graphs
