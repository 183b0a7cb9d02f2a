#pragma once

#include <cstdint>
#include <vector>

#include "runtime/op.h"

namespace slide::ops {

/// foreground_colours().
class ForegroundColoursOp : public Op {
 public:
  [[nodiscard]] std::string_view type() const override { return "foreground_colours"; }
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  /// max(1, the largest |I| of the picture): what F and B, their means and residuals are made of.
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  /// A step has a dozen roundings for F and B, and passes on no more than the errors before it: it projects.
  [[nodiscard]] double definition_factor(std::span<const Shape> inputs, const Shape& output) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;
};

/// One level of the pyramid: its size, and how often its pixels are improved (an even number).
struct MattingLevel {
  std::int64_t h, w;
  int steps;
};
/// All levels of a picture, the smallest first.
[[nodiscard]] std::vector<MattingLevel> matting_levels(std::int64_t h, std::int64_t w);

/// The part of w_ij that does not depend on alpha.
inline constexpr double kSmoothness = 1e-5;
/// Alpha from which a pixel has the subject's colour to start with, and up to which that of what is behind.
inline constexpr double kSurelyFront = 0.9;
inline constexpr double kSurelyBehind = 0.1;

}  // namespace slide::ops
