#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "ops/conv2d/conv2d.h"
#include "runtime/shape.h"

namespace slide::ops {

/// The numbers of one call of a convolution, checked. Pairs of Conv2dParams are spelled out.
struct Conv2dGeometry {
  std::int64_t batch, ic, height, width;    ///< input
  std::int64_t oc, oheight, owidth;         ///< output
  std::int64_t kheight, kwidth;             ///< kernel
  std::int64_t groups, group_ic, group_oc;  ///< channels of one group
  std::int64_t stride_y, stride_x;
  std::int64_t dilation_y, dilation_x;
  std::int64_t top, left;  ///< padding
  bool has_bias;

  /// Products summed for one output element.
  [[nodiscard]] std::int64_t depth() const noexcept { return group_ic * kheight * kwidth; }
  [[nodiscard]] std::int64_t plane() const noexcept { return height * width; }
  [[nodiscard]] std::int64_t oplane() const noexcept { return oheight * owidth; }
  [[nodiscard]] Shape output() const { return {batch, oc, oheight, owidth}; }
};

/// From the shapes x, weight and perhaps bias. Throws Error(kInternal) saying what does not fit.
[[nodiscard]] Conv2dGeometry conv2d_geometry(std::string_view op, std::span<const Shape> inputs,
                                             const Conv2dParams& params);

/// Whether it is a 1×1 convolution that reads every pixel once.
[[nodiscard]] bool reads_once(const Conv2dGeometry& g) noexcept;

/// The same convolution over the image as a single row, where it reads_once(); else as it is.
[[nodiscard]] Conv2dGeometry with_rows_joined(Conv2dGeometry g) noexcept;

/// The filter in row `row` of a group's packed weights. Gated (one group): each feature is followed by its
/// gate, so that a task has both.
[[nodiscard]] std::int64_t filter_of_row(const Conv2dGeometry& g, bool gated, std::int64_t group,
                                         std::int64_t row) noexcept;

/// The output positions first <= o < last that read inside the input, o·stride + offset in [0, extent).
struct TapRange {
  std::int64_t first, last;
};
[[nodiscard]] TapRange tap_range(std::int64_t offset, std::int64_t stride, std::int64_t extent,
                                 std::int64_t output_extent) noexcept;

}  // namespace slide::ops
