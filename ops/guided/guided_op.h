#pragma once

#include <array>

#include "runtime/op.h"

namespace slide::ops {

/// More planes than this a guide has not.
inline constexpr std::int64_t kMostGuidePlanes = 8;

/// guided_coefficients().
class GuidedCoefficientsOp : public Op {
 public:
  GuidedCoefficientsOp(std::int64_t radius, double eps) : radius_(radius), eps_(eps) {}
  [[nodiscard]] std::int64_t radius() const noexcept { return radius_; }
  [[nodiscard]] double eps() const noexcept { return eps_; }

  [[nodiscard]] std::string_view type() const override { return "guided_coefficients"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  /// |y| + 2^-29·K·κ·T: the result's rounding, and what sums and solution in float64 may lose.
  ///
  /// G and P are the largest |guide| and |x| of the picture, n the window's pixels, u = 2^-53, m = 7n + 30,
  /// κ = 1 + G²/eps. Moments of kernel and definition together are off by at most m·u·G² and m·u·G·P; the
  /// solution by Cholesky adds C·(3C + 1)·u·(C·G² + eps) to the matrix for each of the two (Higham, theorem
  /// 10.4). The coefficients are at most T = P/(2·√eps), as (x, guide)'s covariances are positive
  /// semidefinite, and b at most T = P + C·G·P/(2·√eps). As no eigenvalue is under eps, the change of a is at
  /// most 2/eps times those of the right side and of (matrix times T), in all under K·u·κ·T with
  /// K = 6·C·(m + C·(3C + 1)), means of a and b included. That is 2^-24 of the second term above.
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  /// The coefficients are as inexact as x, and as the guide.
  [[nodiscard]] double error_share(std::size_t /*index*/, std::span<const Shape> /*inputs*/) const override {
    return 1;
  }
  /// What float64 may lose is in the scale, as a multiple of 2^-29.
  [[nodiscard]] double definition_factor(std::span<const Shape> /*inputs*/,
                                         const Shape& /*output*/) const override {
    return 0x1p29;
  }
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  std::int64_t radius_;
  double eps_;
};

/// A system of up to kMostGuidePlanes equations with a positive definite matrix.
struct SmallSystem {
  std::array<double, static_cast<std::size_t>(kMostGuidePlanes* kMostGuidePlanes)>
      matrix;  ///< row-major, rows of `count`
  std::array<double, static_cast<std::size_t>(kMostGuidePlanes)> vector;
  std::size_t count;

  /// By Cholesky's factors, from the lower triangle; the solution replaces `vector`, the factor `matrix`.
  void solve();
};

}  // namespace slide::ops
