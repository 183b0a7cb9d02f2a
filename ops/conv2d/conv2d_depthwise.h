#pragma once

#include <cstddef>
#include <span>

#include "ops/conv2d/conv2d_geometry.h"
#include "ops/conv2d/conv2d_routines.h"

namespace slide::ops {

/// A convolution whose groups have one input channel each, directly: a task takes one channel, copies it into
/// a padded plane whose rows are split by the stride (columns 0, s, 2s, ..., then 1, s + 1, ...), so that
/// every tap of every row is a run of adjacent numbers, and sums the taps row by row in registers.
///
/// Error: the bias and the products are summed in order, kh·kw roundings.
class Conv2dDepthwise {
 public:
  Conv2dDepthwise(const Conv2dRoutines& routines, const Conv2dGeometry& geometry);

  /// Whether the geometry has one input channel to a group.
  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry) noexcept { return geometry.group_ic == 1; }

  [[nodiscard]] std::size_t scratch_bytes() const noexcept;
  [[nodiscard]] double error_factor() const noexcept;
  /// bias may be null. Runs at most as many threads as there were when scratch_bytes() was asked.
  void run(const float* x, const float* weight, const float* bias, float* y,
           std::span<std::byte> scratch) const;

 private:
  void pad_plane(const float* x, float* padded) const;
  void run_filter(const float* padded, const float* weight, float bias, const float** taps, float* y) const;
  [[nodiscard]] std::int64_t thread_bytes() const noexcept;

  const Conv2dRoutines& routines_;
  Conv2dGeometry g_;
  std::int64_t rows_;        // of the padded plane that are read
  std::int64_t phase_size_;  // numbers of a row's phase
};

}  // namespace slide::ops
