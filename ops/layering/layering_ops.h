#pragma once

#include <cstdint>
#include <vector>

#include "runtime/op.h"

namespace slide::ops {

/// gaussian_blur().
class GaussianBlurOp : public Op {
 public:
  explicit GaussianBlurOp(double sigma) : sigma_(sigma) {}
  [[nodiscard]] double sigma() const noexcept { return sigma_; }
  /// The weights of the offsets 0, 1, ..., ceil(3·sigma); those of negative offsets are the same.
  [[nodiscard]] std::vector<double> taps() const;

  [[nodiscard]] std::string_view type() const override { return "gaussian_blur"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  [[nodiscard]] double macs(std::span<const Shape> inputs, const Shape& output) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  double sigma_;
};

/// sobel().
class SobelOp : public Op {
 public:
  [[nodiscard]] std::string_view type() const override { return "sobel"; }
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;
};

/// cone_dilation().
class ConeDilationOp : public Op {
 public:
  ConeDilationOp(double rho, std::int64_t radius) : rho_(rho), radius_(radius) {}
  [[nodiscard]] double rho() const noexcept { return rho_; }
  [[nodiscard]] std::int64_t radius() const noexcept { return radius_; }

  [[nodiscard]] std::string_view type() const override { return "cone_dilation"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  double rho_;
  std::int64_t radius_;
};

}  // namespace slide::ops
