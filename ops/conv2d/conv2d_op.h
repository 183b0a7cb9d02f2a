#pragma once

#include "ops/conv2d/conv2d_geometry.h"
#include "runtime/op.h"

namespace slide::ops {

/// The operator of conv2d(); its kernels read the parameters from it.
class Conv2dOp : public Op {
 public:
  explicit Conv2dOp(const Conv2dParams& params) : params_(params) {}

  [[nodiscard]] std::string_view type() const override { return "conv2d"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  /// |w| ∗ |x| + |b|, and for each product and the bias 2^-102, so that u times it covers results and
  /// operands that are flushed to zero below the smallest normal float32, 2^-126.
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  [[nodiscard]] double macs(std::span<const Shape> inputs, const Shape& output) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

  [[nodiscard]] const Conv2dParams& params() const noexcept { return params_; }

 private:
  Conv2dParams params_;
};

/// "stride 2 dilation 1 groups 32 padding 1,1,1,1": the attributes that are not the default.
[[nodiscard]] std::string text_of(const Conv2dParams& params);

/// The shapes of tensors, for functions that are given tensors only.
[[nodiscard]] std::vector<Shape> shapes_of(std::span<const Tensor> tensors);

/// The definition in float64: y[n,o] = b[o], then for each tap (c, u, v) in this order one product is added.
/// `inputs` are F64: x, weight, perhaps bias.
void conv2d_reference(const Conv2dGeometry& g, std::span<const Tensor> inputs, std::span<double> y);

/// Conv2dOp::error_scale() for any operator that starts with a convolution.
void conv2d_error_scale(const Conv2dGeometry& g, std::span<const Tensor> inputs, std::span<double> scale);

}  // namespace slide::ops
