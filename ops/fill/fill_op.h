#pragma once

#include "runtime/op.h"

namespace slide::ops {

/// push_pull_fill().
class PushPullFillOp : public Op {
 public:
  explicit PushPullFillOp(int sweeps) : sweeps_(sweeps) {}
  [[nodiscard]] int sweeps() const noexcept { return sweeps_; }

  [[nodiscard]] std::string_view type() const override { return "push_pull_fill"; }
  [[nodiscard]] std::string attributes() const override { return "sweeps " + std::to_string(sweeps_); }
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  /// The largest |x| of the plane: every step is an average.
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  int sweeps_;
};

/// The pull's filter, along rows and along columns.
inline constexpr double kPull[] = {0.125, 0.375, 0.375, 0.125};
/// A cell whose mean weight is over 1 / kTrust counts as known.
inline constexpr double kTrust = 16;
/// The smallest mean weight that is divided by.
inline constexpr double kLeastWeight = 1e-12;

}  // namespace slide::ops
