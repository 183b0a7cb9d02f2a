#pragma once

#include "runtime/op.h"
#include "runtime/sensitivity.h"

namespace slide::ops {

enum class BinaryKind { kAdd, kSub, kMul, kDiv, kMinimum, kMaximum };

/// A function of two values, with broadcasting. See ops/pointwise/pointwise.h for the definitions.
class BinaryOp : public Op, public StatesStatistics {
 public:
  explicit BinaryOp(BinaryKind kind) : kind_(kind) {}

  [[nodiscard]] BinaryKind kind() const noexcept { return kind_; }
  /// The function at one point, in float64.
  [[nodiscard]] double evaluate(double a, double b) const;

  [[nodiscard]] std::string_view type() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  [[nodiscard]] bool by_rows() const override { return true; }
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  /// Products and quotients have the relative errors of both operands.
  [[nodiscard]] double error_share(std::size_t index, std::span<const Shape> inputs) const override;
  [[nodiscard]] NodeStatistics statistics(const StatisticsCall& call) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  BinaryKind kind_;
};

}  // namespace slide::ops
