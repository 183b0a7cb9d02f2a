#pragma once

#include <array>
#include <vector>

#include "runtime/op.h"

namespace slide::ops {

enum class ReduceKind { kMin, kMax, kMean };

/// reduce_min(), reduce_max() and reduce_mean().
class ReduceOp : public Op {
 public:
  /// The axes may be negative: from the end.
  ReduceOp(ReduceKind kind, std::vector<int> axes) : kind_(kind), axes_(std::move(axes)) {}
  [[nodiscard]] ReduceKind kind() const noexcept { return kind_; }
  [[nodiscard]] const std::vector<int>& axes() const noexcept { return axes_; }
  /// For each axis of a tensor of that shape whether it is reduced. Throws Error(kInternal) if the axes do
  /// not fit.
  [[nodiscard]] std::array<bool, Shape::kMaxRank> reduced(const Shape& shape) const;

  [[nodiscard]] std::string_view type() const override;
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  /// The sum of what becomes one element.
  [[nodiscard]] double definition_factor(std::span<const Shape> inputs, const Shape& output) const override {
    return 2 + static_cast<double>(inputs[0].count()) / static_cast<double>(output.count());
  }
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  ReduceKind kind_;
  std::vector<int> axes_;
};

}  // namespace slide::ops
