#pragma once

#include <array>
#include <cstdint>

#include "runtime/shape.h"

namespace slide::ops {

/// The shape two shapes broadcast to as in NumPy: aligned at the last axis, extents equal or 1. Throws
/// Error(kInternal) naming both shapes if they do not.
[[nodiscard]] Shape broadcast_shape(const Shape& a, const Shape& b);

/// How to walk through two broadcast tensors as rows: neighbouring axes that both tensors step through alike
/// are merged, and a row is a run along the last merged axis.
class BroadcastRows {
 public:
  BroadcastRows(const Shape& a, const Shape& b, const Shape& output);

  [[nodiscard]] std::int64_t rows() const noexcept { return rows_; }
  [[nodiscard]] std::int64_t length() const noexcept { return length_; }
  /// The distance of a row's neighbouring elements, 0 or 1.
  [[nodiscard]] std::int64_t a_step() const noexcept { return a_step_; }
  [[nodiscard]] std::int64_t b_step() const noexcept { return b_step_; }
  struct Start {
    std::int64_t a, b;
  };
  /// Where row i starts in the two tensors. In the output it is at i · length().
  [[nodiscard]] Start start(std::int64_t row) const noexcept;

 private:
  struct Axis {
    std::int64_t extent, a_stride, b_stride;
  };
  std::array<Axis, Shape::kMaxRank> outer_{};  // last varies fastest
  int outer_rank_ = 0;
  std::int64_t rows_ = 1;
  std::int64_t length_ = 1;
  std::int64_t a_step_ = 0;
  std::int64_t b_step_ = 0;
};

}  // namespace slide::ops
