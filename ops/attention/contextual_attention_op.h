#pragma once

#include "ops/attention/contextual_attention.h"
#include "runtime/op.h"

namespace slide::ops {

/// The operator of contextual_attention().
///
/// With r = rate, the features reduced by taking every r-th pixel (0, r, 2r, ...) to h×w, n = h·w positions:
///   scores   S[l,p] = <patch of background at l, patch of foreground at p> / max(|patch at l|, 1e-4), the
///            patches patch × patch at stride 1, zero outside;
///   fusing   F over the n×n plane S (zero outside), then, with both axes taken in column-major order of the
///            positions, F again;
///   mask     m[l] = 1 where no pixel of the mask lies in the patch at l, else 0;
///   weights  A[l,p] = m[l] · softmax over l of (softmax_scale · m[l] · S[l,p]);
///   result   for each p the patches of the full background, 2r × 2r, weighted by A[.,p] and added up around
///            r·p; where they overlap (four deep) a quarter of the sum.
/// Large patches start r/2 before their block, as TensorFlow's "same" padding has it in the authors' code.
class ContextualAttentionOp : public Op {
 public:
  explicit ContextualAttentionOp(const ContextualAttentionParams& params) : params_(params) {}

  [[nodiscard]] std::string_view type() const override { return "contextual_attention"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  /// With E the scores' own scale (the same steps over absolute values), a relative error of the scores of
  /// u·E changes A[l,p] by at most the factor e^(softmax_scale·u·(E[l,p] + mean of E[.,p] under the softmax)), so
  ///   sum over the patches of (A + 2^-102) · |background| / 4 · (1 + softmax_scale · (E + mean E)) + 2^-102,
  /// 2^-102 for what is flushed to zero.
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  [[nodiscard]] double macs(std::span<const Shape> inputs, const Shape& output) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

  [[nodiscard]] const ContextualAttentionParams& params() const noexcept { return params_; }

 private:
  ContextualAttentionParams params_;
};

/// The numbers of one call, checked.
struct AttentionGeometry {
  std::int64_t channels, height, width;   ///< features
  std::int64_t rows, columns;             ///< positions, at the reduced resolution
  std::int64_t mask_step_y, mask_step_x;  ///< mask pixels per position
  std::int64_t mask_width;
  std::int64_t rate, patch, fuse;
  double softmax_scale;

  [[nodiscard]] std::int64_t positions() const noexcept { return rows * columns; }
  [[nodiscard]] std::int64_t plane() const noexcept { return height * width; }
};

/// From the shapes foreground, background, mask and perhaps fuse_weight. Throws Error(kInternal) saying what
/// does not fit.
[[nodiscard]] AttentionGeometry attention_geometry(std::span<const Shape> inputs,
                                                   const ContextualAttentionParams& params);

}  // namespace slide::ops
