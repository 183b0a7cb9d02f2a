#pragma once

#include "runtime/op.h"

namespace slide::ops {

/// mirror_known().
class MirrorKnownOp : public Op {
 public:
  [[nodiscard]] std::string_view type() const override { return "mirror_known"; }
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;
};

/// The weight from which a pixel is known.
inline constexpr double kKnown = 0.5;

}  // namespace slide::ops
