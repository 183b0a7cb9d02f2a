#pragma once

#include <cstdint>

#include "runtime/op.h"

namespace slide::ops {

/// The extents of one call of attention().
struct AttentionExtents {
  std::int64_t batch, heads;
  std::int64_t depth;        ///< channels of a head in queries and keys
  std::int64_t value_depth;  ///< and in values
  std::int64_t queries, keys;
};

/// attention(); inputs query, key, value.
class AttentionOp : public Op {
 public:
  AttentionOp(std::int64_t heads, double scale) : heads_(heads), scale_(scale) {}
  [[nodiscard]] std::int64_t heads() const noexcept { return heads_; }
  [[nodiscard]] double scale() const noexcept { return scale_; }
  /// Of inputs that infer() accepts.
  [[nodiscard]] AttentionExtents extents(std::span<const Shape> inputs) const;
  /// error_scale() where scores may change by `most` of what their errors are relative to.
  void error_scale_of(std::span<const Tensor> inputs, double most, Tensor& scale) const;

  [[nodiscard]] std::string_view type() const override { return "attention"; }
  [[nodiscard]] std::string attributes() const override;
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const override;
  [[nodiscard]] double macs(std::span<const Shape> inputs, const Shape& output) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;

 private:
  std::int64_t heads_;
  double scale_;
};

}  // namespace slide::ops
