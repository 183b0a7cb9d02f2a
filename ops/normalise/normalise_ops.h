#pragma once

#include <cstdint>
#include <memory>
#include <utility>

#include "ops/pointwise/unary_op.h"
#include "runtime/op.h"
#include "runtime/sensitivity.h"

namespace slide::ops {

/// batch_norm(); inputs x, weight, bias, running_mean, running_var.
class BatchNormOp : public Op, public StatesStatistics {
 public:
  explicit BatchNormOp(double eps) : eps_(eps) {}
  [[nodiscard]] double eps() const noexcept { return eps_; }

  [[nodiscard]] std::string_view type() const override { return "batch_norm"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  [[nodiscard]] NodeStatistics statistics(const StatisticsCall& call) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  double eps_;
};

/// What a group norm may do beside normalising, in the order of the computation (ops/fusion).
struct GroupNormFusion {
  bool residual = false;  ///< the last input, of the output's shape, is added
  std::shared_ptr<const UnaryOp> activation = nullptr;
};

/// group_norm(); inputs x, weight, bias and, if fused, a residual.
class GroupNormOp : public Op, public StatesStatistics {
 public:
  GroupNormOp(std::int64_t groups, double eps, GroupNormFusion fusion = {})
      : groups_(groups), eps_(eps), fusion_(std::move(fusion)) {}
  [[nodiscard]] std::int64_t groups() const noexcept { return groups_; }
  [[nodiscard]] double eps() const noexcept { return eps_; }
  [[nodiscard]] const GroupNormFusion& fusion() const noexcept { return fusion_; }

  [[nodiscard]] std::string_view type() const override { return "group_norm"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  /// The sums of a group.
  [[nodiscard]] double definition_factor(std::span<const Shape> inputs,
                                         const Shape& /*output*/) const override {
    const std::int64_t count = inputs[0].count() / inputs[0][0] / groups_;
    return 16 + static_cast<double>(count);
  }
  [[nodiscard]] NodeStatistics statistics(const StatisticsCall& call) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  std::int64_t groups_;
  double eps_;
  GroupNormFusion fusion_;
};

/// layer_norm() along an axis, which may be negative; inputs x, weight, bias.
class LayerNormOp : public Op {
 public:
  LayerNormOp(int axis, double eps) : axis_(axis), eps_(eps) {}
  [[nodiscard]] int axis() const noexcept { return axis_; }
  [[nodiscard]] double eps() const noexcept { return eps_; }

  [[nodiscard]] std::string_view type() const override { return "layer_norm"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  /// The sums of a line.
  [[nodiscard]] double definition_factor(std::span<const Shape> inputs,
                                         const Shape& /*output*/) const override {
    return 16 + static_cast<double>(inputs[1].count());
  }
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  int axis_;
  double eps_;
};

/// weight_standardise(); input weight.
class WeightStandardiseOp : public Op {
 public:
  explicit WeightStandardiseOp(double eps) : eps_(eps) {}
  [[nodiscard]] double eps() const noexcept { return eps_; }

  [[nodiscard]] std::string_view type() const override { return "weight_standardise"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  [[nodiscard]] bool by_rows() const override { return true; }
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  /// The sums of a filter.
  [[nodiscard]] double definition_factor(std::span<const Shape> inputs,
                                         const Shape& /*output*/) const override {
    const std::int64_t count = inputs[0].count() / inputs[0][0];
    return 16 + static_cast<double>(count);
  }
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  double eps_;
};

/// min_max_normalise().
class MinMaxNormaliseOp : public Op {
 public:
  [[nodiscard]] std::string_view type() const override { return "min_max_normalise"; }
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;
};

/// Whether a smallest and a largest value make a scene without relief.
[[nodiscard]] bool without_relief(double least, double largest) noexcept;

}  // namespace slide::ops
