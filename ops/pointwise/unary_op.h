#pragma once

#include "runtime/op.h"
#include "runtime/sensitivity.h"

namespace slide::ops {

enum class UnaryKind {
  kRelu,
  kRelu6,
  kLeakyRelu,
  kElu,
  kSigmoid,
  kTanh,
  kExp,
  kSqrt,
  kAbs,
  kClip,
  kAffine,
  kGreater,
  kSilu,
  kGelu,
};

/// What a function makes of normally distributed values: mean and variance of its results, and the mean square
/// of its slope, which errors are multiplied by.
struct FunctionStatistics {
  double mean, variance, square_of_slope;
};

/// A function of one value, applied to every element. See ops/pointwise/pointwise.h for the definitions.
class UnaryOp : public Op, public StatesStatistics {
 public:
  /// `a` and `b` are the function's attributes in the order of its declaration; unused ones are 0.
  explicit UnaryOp(UnaryKind kind, double a = 0, double b = 0) : kind_(kind), a_(a), b_(b) {}

  [[nodiscard]] UnaryKind kind() const noexcept { return kind_; }
  [[nodiscard]] double a() const noexcept { return a_; }
  [[nodiscard]] double b() const noexcept { return b_; }
  /// The function at one point, in float64. NaN in gives NaN out, but for kGreater, which gives 0.
  [[nodiscard]] double evaluate(double x) const;
  [[nodiscard]] FunctionStatistics statistics_at(double mean, double variance) const;

  [[nodiscard]] std::string_view type() const override;
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  [[nodiscard]] bool by_rows() const override { return true; }
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  [[nodiscard]] NodeStatistics statistics(const StatisticsCall& call) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  UnaryKind kind_;
  double a_;
  double b_;
};

}  // namespace slide::ops
