#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "ops/tensor_shape/tensor_shape.h"
#include "runtime/op.h"
#include "runtime/sensitivity.h"
#include "runtime/storage.h"

namespace slide::ops {

/// concat() along an axis >= 0.
class ConcatOp : public Op, public SharesStorage, public StatesStatistics {
 public:
  explicit ConcatOp(int axis) : axis_(axis) {}
  [[nodiscard]] int axis() const noexcept { return axis_; }

  [[nodiscard]] std::string_view type() const override { return "concat"; }
  [[nodiscard]] std::string attributes() const override { return "axis " + std::to_string(axis_); }
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  [[nodiscard]] std::optional<std::int64_t> storage_offset(std::size_t index,
                                                           std::span<const Shape> inputs) const override;
  [[nodiscard]] NodeStatistics statistics(const StatisticsCall& call) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  int axis_;
};

/// slice() of an axis.
class SliceOp : public Op, public SharesStorage {
 public:
  SliceOp(int axis, std::int64_t start, std::int64_t end) : axis_(axis), start_(start), end_(end) {}
  /// May be negative: from the end.
  [[nodiscard]] int axis() const noexcept { return axis_; }
  [[nodiscard]] std::int64_t start() const noexcept { return start_; }
  [[nodiscard]] std::int64_t end() const noexcept { return end_; }

  [[nodiscard]] std::string_view type() const override { return "slice"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  [[nodiscard]] std::optional<std::int64_t> storage_offset(std::size_t index,
                                                           std::span<const Shape> inputs) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  int axis_;
  std::int64_t start_;
  std::int64_t end_;
};

/// pad() of the last two axes.
class PadOp : public Op {
 public:
  PadOp(const std::array<std::int64_t, 4>& padding, PadMode mode, double value)
      : padding_(padding), mode_(mode), value_(value) {}
  [[nodiscard]] const std::array<std::int64_t, 4>& padding() const noexcept { return padding_; }
  [[nodiscard]] PadMode mode() const noexcept { return mode_; }
  [[nodiscard]] double value() const noexcept { return value_; }

  [[nodiscard]] std::string_view type() const override { return "pad"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  std::array<std::int64_t, 4> padding_;
  PadMode mode_;
  double value_;
};

/// permute() of all axes.
class PermuteOp : public Op {
 public:
  explicit PermuteOp(std::vector<int> axes) : axes_(std::move(axes)) {}
  [[nodiscard]] const std::vector<int>& axes() const noexcept { return axes_; }

  [[nodiscard]] std::string_view type() const override { return "permute"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  std::vector<int> axes_;
};

/// reshape() to a fixed shape.
class ReshapeOp : public Op, public SharesStorage {
 public:
  explicit ReshapeOp(const Shape& shape) : shape_(shape) {}

  [[nodiscard]] std::string_view type() const override { return "reshape"; }
  [[nodiscard]] std::string attributes() const override { return "to " + shape_.text(); }
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  [[nodiscard]] std::optional<std::int64_t> storage_offset(std::size_t index,
                                                           std::span<const Shape> inputs) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  Shape shape_;
};

}  // namespace slide::ops
