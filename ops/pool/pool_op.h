#pragma once

#include <algorithm>

#include "ops/common/elements.h"
#include "ops/pool/pool.h"
#include "runtime/op.h"

namespace slide::ops {

/// The input positions [begin, end) a window covers along one axis, cut at the input's border.
struct PoolWindow {
  std::int64_t begin, end;
};

enum class PoolKind { kMax, kAverage };

/// max_pool2d() and avg_pool2d().
class PoolOp : public Op {
 public:
  PoolOp(PoolKind kind, const PoolParams& params) : kind_(kind), params_(params) {}
  [[nodiscard]] PoolKind kind() const noexcept { return kind_; }
  [[nodiscard]] const PoolParams& params() const noexcept { return params_; }
  /// The window of an output row (axis 0) or column (axis 1) of an input of that extent.
  [[nodiscard]] PoolWindow window(int axis, std::int64_t output_index, std::int64_t extent) const;
  /// What the sum along that axis is divided by, for average pooling: the window's length with its padding if
  /// that counts, but never with what lies beyond the padding.
  [[nodiscard]] std::int64_t divisor(int axis, std::int64_t output_index, std::int64_t extent) const;

  [[nodiscard]] std::string_view type() const override;
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  /// The sum of a window.
  [[nodiscard]] double definition_factor(std::span<const Shape> inputs,
                                         const Shape& /*output*/) const override {
    return 2 + static_cast<double>(std::min(params_.kernel[0], inputs[0][2]) *
                                   std::min(params_.kernel[1], inputs[0][3]));
  }
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  PoolKind kind_;
  PoolParams params_;
};

/// adaptive_avg_pool2d(), and global_avg_pool2d() as its case 1×1.
class AdaptiveAvgPoolOp : public Op {
 public:
  AdaptiveAvgPoolOp(std::int64_t height, std::int64_t width) : height_(height), width_(width) {}
  [[nodiscard]] std::int64_t height() const noexcept { return height_; }
  [[nodiscard]] std::int64_t width() const noexcept { return width_; }
  /// The window of output index i of `count` along an axis of `extent`.
  [[nodiscard]] static PoolWindow window(std::int64_t i, std::int64_t count, std::int64_t extent) {
    return {i * extent / count, ((i + 1) * extent + count - 1) / count};
  }

  [[nodiscard]] std::string_view type() const override { return "adaptive_avg_pool2d"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  /// The sums of a plane.
  [[nodiscard]] double definition_factor(std::span<const Shape> inputs,
                                         const Shape& /*output*/) const override {
    return 16 + static_cast<double>(inputs[0][2] * inputs[0][3]);
  }
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  std::int64_t height_;
  std::int64_t width_;
};

}  // namespace slide::ops
