#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ops/conv2d/conv2d_geometry.h"
#include "ops/conv2d/conv2d_method.h"
#include "ops/conv2d/conv2d_routines.h"

namespace slide::ops {

/// A convolution whose groups have one input channel each, directly: a task takes one channel, copies it into
/// padded planes that are split by the stride (conv2d_direct.h), so that every tap of all output positions is
/// a run of adjacent numbers, and sums the taps in registers; the positions in the padding are dropped.
///
/// Error: the bias and the products are summed in order, kh·kw roundings.
class Conv2dDepthwise {
 public:
  static constexpr Precision kPrecision = Precision::kFp32;
  Conv2dDepthwise(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                  const Conv2dFusion& fusion = {});

  /// Whether there is one input channel to a group, and no gate.
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
                  float* sums) const;
  [[nodiscard]] std::int64_t padded_size() const noexcept;
  [[nodiscard]] std::int64_t thread_size() const noexcept;

  const Conv2dRoutines& routines_;
  Conv2dGeometry g_;
  bool relu_input_;
  Conv2dEpilogue epilogue_;
  std::int64_t plane_width_, plane_rows_;  // of one phase
  std::int64_t chunk_rows_;                // of output rows whose sums are in flight
  std::vector<std::int32_t> offsets_;      // of the taps
};

}  // namespace slide::ops
