#pragma once

#include <cstddef>
#include <span>

#include "ops/conv2d/conv2d_geometry.h"
#include "ops/conv2d/conv2d_method.h"
#include "ops/conv2d/conv2d_routines.h"
#include "ops/pointwise/unary_row.h"

namespace slide::ops {

/// A convolution whose groups have one input channel each, directly: a task takes one channel, copies it into
/// a padded plane whose rows are split by the stride (columns 0, s, 2s, ..., then 1, s + 1, ...), so that
/// every tap of every row is a run of adjacent numbers, and sums the taps row by row in registers.
///
/// Error: the bias and the products are summed in order, kh·kw roundings.
class Conv2dDepthwise {
 public:
  static constexpr Precision kPrecision = Precision::kFp32;
  Conv2dDepthwise(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                  const Conv2dFusion& fusion = {});

  /// Whether the geometry has one input channel to a group.
  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept {
    return geometry.group_ic == 1 && !fusion.upsample_input && !fusion.gate;
  }

  /// The weight as it is.
  [[nodiscard]] std::size_t packed_bytes() const noexcept;
  void pack(const float* weight, std::byte* packed) const;
  [[nodiscard]] std::size_t scratch_bytes() const noexcept;
  [[nodiscard]] double error_factor() const noexcept;
  [[nodiscard]] double macs() const noexcept;
  /// Runs at most as many threads as there were when scratch_bytes() was asked.
  void run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const;

 private:
  void pad_plane(const float* x, float* padded) const;
  void run_filter(std::int64_t plane, std::int64_t filter, const float* padded, const Conv2dArrays& arrays,
                  const float** taps) const;
  [[nodiscard]] std::int64_t thread_bytes() const noexcept;

  const Conv2dRoutines& routines_;
  Conv2dGeometry g_;
  bool relu_input_;
  UnaryRow relu_;
  Conv2dEpilogue epilogue_;
  std::int64_t rows_;        // of the padded plane that are read
  std::int64_t phase_size_;  // numbers of a row's phase
};

}  // namespace slide::ops
