#pragma once

#include "runtime/op.h"

namespace slide::ops {

/// softmax() along an axis; may be negative: from the end.
class SoftmaxOp : public Op {
 public:
  explicit SoftmaxOp(int axis) : axis_(axis) {}
  [[nodiscard]] int axis() const noexcept { return axis_; }

  [[nodiscard]] std::string_view type() const override { return "softmax"; }
  [[nodiscard]] std::string attributes() const override { return "axis " + std::to_string(axis_); }
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  /// The sums of an axis.
  [[nodiscard]] double definition_factor(std::span<const Shape> inputs,
                                         const Shape& /*output*/) const override {
    return 16 + static_cast<double>(inputs[0].count());
  }
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  int axis_;
};

}  // namespace slide::ops
