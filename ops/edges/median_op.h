#pragma once

#include <cmath>

#include "runtime/op.h"

namespace slide::ops {

/// A larger window's median says nothing about edges.
inline constexpr std::int64_t kLargestMedianRadius = 1024;

/// median().
class MedianOp : public Op {
 public:
  explicit MedianOp(std::int64_t radius) : radius_(radius) {}
  [[nodiscard]] std::int64_t radius() const noexcept { return radius_; }

  [[nodiscard]] std::string_view type() const override { return "median"; }
  [[nodiscard]] std::string attributes() const override { return "radius " + std::to_string(radius_); }
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  std::int64_t radius_;
};

}  // namespace slide::ops
