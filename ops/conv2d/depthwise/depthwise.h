#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "ops/conv2d/conv2d_geometry.h"
#include "ops/conv2d/conv2d_method.h"
#include "ops/conv2d/conv2d_routines.h"

namespace slide::ops {

/// A convolution whose groups have one input channel each, directly: a task takes one channel, copies it into
/// planes that are split by the stride (direct/direct.h), so that every tap of all output positions is a run
/// of adjacent numbers, and sums the taps in registers.
///
/// Where input and output are of the same size, or one twice the other at stride 2, and the kernel has up to
/// 5 rows, planes have no borders at the sides: lanes go on from row to row, so that planes narrower than a
/// vector fill it, too. What a column of the filter reads beyond the ends of rows is masked out of that
/// column's sum. Otherwise planes are padded, and the positions in the padding are dropped.
///
/// Error: each column of taps is summed in order, then the bias and the columns: kh + kw roundings. With
/// padded planes the bias and the products are summed in order: kh·kw roundings.
class Conv2dDepthwise {
 public:
  static constexpr Precision kPrecision = Precision::kFp32;
  Conv2dDepthwise(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                  const Conv2dFusion& fusion = {});
  Conv2dDepthwise(const Conv2dDepthwise&) = delete;
  Conv2dDepthwise& operator=(const Conv2dDepthwise&) = delete;

  /// Whether there is one input channel to a group, and no gate.
  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept {
    return geometry.group_ic == 1 && !fusion.upsamples() && !fusion.gate;
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
  [[nodiscard]] bool can_join_rows() const noexcept;
  void list_runs();
  void copy_plane(const float* x, float* planes) const;
  void run_joined(std::int64_t plane, std::int64_t filter, const float* planes,
                  const Conv2dArrays& arrays) const;
  void pad_plane(const float* x, float* padded) const;
  void spoil_padded(const float* weight, float* y) const;
  void run_plane(std::int64_t plane, float* padded, const Conv2dArrays& arrays, float* sums) const;
  void run_filter(std::int64_t plane, std::int64_t filter, const float* padded, const Conv2dArrays& arrays,
                  float* sums) const;
  [[nodiscard]] std::int64_t padded_size() const noexcept;
  [[nodiscard]] std::int64_t thread_size() const noexcept;

  const Conv2dRoutines& routines_;
  Conv2dGeometry g_;
  Conv2dEpilogue epilogue_;
  float least_;  // of x, where x is cut
  bool joined_;  // rows follow each other without a border
  // Joined:
  std::int64_t step_rows_ = 1;                // that whole vectors fill best
  std::int64_t margin_ = 0, phase_size_ = 0;  // zeros around a plane; from one phase to the next
  std::vector<DepthwiseRun> runs_;
  std::vector<float> masks_;
  // Padded:
  std::int64_t plane_width_, plane_rows_;  // of one phase
  std::int64_t chunk_rows_;                // of output rows whose sums are in flight
  std::vector<std::int32_t> offsets_;      // of the taps
};

}  // namespace slide::ops
