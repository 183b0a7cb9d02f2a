#pragma once

#include <utility>

#include "ops/conv2d/conv2d_geometry.h"
#include "ops/conv2d/conv2d_method.h"
#include "runtime/op.h"
#include "runtime/sensitivity.h"

namespace slide::ops {

/// The operator of conv2d() and gated_conv2d(), and what a planner makes of one and its neighbours. Inputs:
/// x, weight, perhaps bias. With a residual or joined channels there is a bias, and they come after it, in
/// this order.
class Conv2dOp : public Op, public StatesStatistics {
 public:
  explicit Conv2dOp(const Conv2dParams& params, Conv2dFusion fusion = {})
      : params_(params), fusion_(std::move(fusion)) {}

  /// "conv2d", or "gated_conv2d" with a gate.
  [[nodiscard]] std::string_view type() const override;
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  /// For the convolution s = |w| ∗ |x| + |b|, and for each product and the bias 2^-102, so that u times it
  /// covers results and operands that are flushed to zero below the smallest normal float32, 2^-126; plus
  /// |residual|. An activation of slope at most L makes of it L·s + |y|; a residual behind it adds |residual|
  /// to that. A gate, with s_a and s_g the scale
  /// at a and g, makes of it
  ///   s_a · gate + |elu(a)| · s_g · min(1/4, gate) + |y| + 2^-102 · (1 + |elu(a)|),
  ///   gate = min(1, sigmoid(g) · e^(s_g / 64)).
  /// elu has slope at most 1, which carries an error of a to y by the factor sigmoid. sigmoid has slope
  /// sigmoid·(1 - sigmoid), at most 1/4 and at most sigmoid. An error d of g makes the sigmoid grow by e^|d|
  /// at most; for |d| = c·u·s_g that is within e^(s_g / 64) wherever c·u <= 1/64, so that gate bounds the
  /// sigmoid at both ends and the scale holds for large errors too. |y| stands for the roundings of the
  /// functions and products, the last term for a sigmoid and a product flushed to zero.
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  /// As error_scale(), from another scale `sums` of the convolution's sums (elements of geometry().output()),
  /// of which errors are at most the part `largest`. The functions' roundings and the residual count
  /// `rounding` times their size.
  void error_scale_of_sums(std::span<const Tensor> inputs, std::span<const double> sums, const Tensor& output,
                           Tensor& scale, double rounding = 1, double largest = 1.0 / 64) const;
  [[nodiscard]] double macs(std::span<const Shape> inputs, const Shape& output) const override;
  /// x and a residual count as equal; joined channels are a part of x.
  [[nodiscard]] double error_share(std::size_t index, std::span<const Shape> inputs) const override;
  /// Of a constant weight and bias.
  [[nodiscard]] NodeStatistics statistics(const StatisticsCall& call) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

  [[nodiscard]] const Conv2dParams& params() const noexcept { return params_; }
  [[nodiscard]] const Conv2dFusion& fusion() const noexcept { return fusion_; }
  /// Of the convolution: upsampled and joined input, output before the gate.
  [[nodiscard]] Conv2dGeometry geometry(std::span<const Shape> inputs) const;
  /// x as the convolution sees it (upsampled and joined, below zero cut off), weight and perhaps bias, F64.
  [[nodiscard]] std::vector<Tensor> convolution_inputs(std::span<const Tensor> inputs) const;
  /// The same for error scales: of what is upsampled bilinearly, which rounds, the upsampled magnitudes.
  [[nodiscard]] std::vector<Tensor> scale_inputs(std::span<const Tensor> inputs) const;

 private:
  Conv2dParams params_;
  Conv2dFusion fusion_;
};

/// "stride 2 dilation 1 groups 32 padding 1,1,1,1": the attributes that are not the default.
[[nodiscard]] std::string text_of(const Conv2dParams& params);

/// The shapes of tensors, for functions that are given tensors only.
[[nodiscard]] std::vector<Shape> shapes_of(std::span<const Tensor> tensors);

/// The definition in float64: y[n,o] = b[o], then for each tap (c, u, v) in this order one product is added.
/// `inputs` are F64: x, weight, perhaps bias.
void conv2d_reference(const Conv2dGeometry& g, std::span<const Tensor> inputs, std::span<double> y);

/// |w| ∗ |x| + |b| and what underflow adds; see Conv2dOp::error_scale().
void conv2d_error_scale(const Conv2dGeometry& g, std::span<const Tensor> inputs, std::span<double> scale);

}  // namespace slide::ops
