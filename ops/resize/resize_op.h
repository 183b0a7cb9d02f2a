#pragma once

#include <vector>

#include "ops/resize/resize.h"
#include "runtime/op.h"

namespace slide::ops {

/// How one axis is resampled: output i is the sum over k of weight[i·taps+k] · input[index[i·taps+k]].
struct ResizeAxis {
  int taps;                         ///< 1 nearest, 2 linear, 4 cubic
  std::vector<std::int64_t> index;  ///< cut at the border, so replicating it
  std::vector<double> weight;
};

/// What a resize may do beside resampling (ops/fusion).
struct ResizeFusion {
  bool residual = false;  ///< the last input, of the output's shape, is added
};

/// resize(); inputs x and, if fused, a residual.
class ResizeOp : public Op {
 public:
  explicit ResizeOp(const ResizeParams& params, ResizeFusion fusion = {})
      : params_(params), fusion_(fusion) {}
  [[nodiscard]] const ResizeParams& params() const noexcept { return params_; }
  [[nodiscard]] const ResizeFusion& fusion() const noexcept { return fusion_; }
  /// Rows (axis 0) or columns (axis 1) of an input with that extent.
  [[nodiscard]] ResizeAxis axis(int axis, std::int64_t extent) const;

  [[nodiscard]] std::string_view type() const override { return "resize"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  /// x and a residual count as equal.
  [[nodiscard]] double error_share(std::size_t index, std::span<const Shape> inputs) const override;
  /// A coordinate has three roundings of at most the extent, and each of the taps' weights has its error.
  [[nodiscard]] double definition_factor(std::span<const Shape> inputs,
                                         const Shape& /*output*/) const override {
    return 16 + 6 * static_cast<double>(inputs[0][2] + inputs[0][3]);
  }
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  ResizeParams params_;
  ResizeFusion fusion_;
};

}  // namespace slide::ops
