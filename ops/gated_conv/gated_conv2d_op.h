#pragma once

#include "ops/conv2d/conv2d_geometry.h"
#include "ops/gated_conv/gated_conv2d.h"
#include "runtime/op.h"

namespace slide::ops {

/// The operator of gated_conv2d().
class GatedConv2dOp : public Op {
 public:
  explicit GatedConv2dOp(const Conv2dParams& params) : params_(params) {}

  [[nodiscard]] std::string_view type() const override { return "gated_conv2d"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  /// With s_a and s_g the convolution's scale at a and g:
  ///   s_a · gate + |elu(a)| · s_g · min(1/4, gate) + |y| + 2^-102 · (1 + |elu(a)|),
  ///   gate = min(1, sigmoid(g) · e^(s_g / 64)).
  /// elu has slope at most 1, which carries an error of a to y by the factor sigmoid. sigmoid has slope
  /// sigmoid·(1 - sigmoid), at most 1/4 and at most sigmoid. An error d of g makes the sigmoid grow by e^|d|
  /// at most; for |d| = c·u·s_g that is within e^(s_g / 64) wherever c·u <= 1/64, so that gate bounds the
  /// sigmoid at both ends and the scale holds for large errors too. |y| stands for the roundings of elu,
  /// sigmoid and their product, the last term for a sigmoid and a product flushed to zero.
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  [[nodiscard]] double macs(std::span<const Shape> inputs, const Shape& output) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

  [[nodiscard]] const Conv2dParams& params() const noexcept { return params_; }
  /// The convolution before the gate: twice the channels of the output.
  [[nodiscard]] Conv2dGeometry geometry(std::span<const Shape> inputs) const;

 private:
  Conv2dParams params_;
};

}  // namespace slide::ops
