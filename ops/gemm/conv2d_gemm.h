#pragma once

#include <cstddef>
#include <span>

#include "ops/conv2d/conv2d_geometry.h"
#include "ops/conv2d/conv2d_method.h"
#include "ops/conv2d/conv2d_routines.h"
#include "ops/pointwise/unary_row.h"

namespace slide::ops {

/// A convolution as a product of matrices, weight (oc × K) by columns (K × positions), K = ic/groups·kh·kw,
/// in tiles: a task takes one tile of positions (a panel of the routines) and a run of output channels. It
/// goes through K in blocks; of each it packs the columns, multiplies them with all its weights and adds the
/// result to the tile. So scratch memory holds a tile for each thread, never the columns of an image.
///
/// Error: an output is the sum of its blocks, and a block the sum of its products in order, so no product
/// meets more than block_depth + blocks roundings. With blocks of K^½ products this is 2·K^½, and it is a
/// bound, not an expectation: it holds for all-equal and for cancelling terms alike.
class Conv2dGemm {
 public:
  static constexpr Precision kPrecision = Precision::kFp32;
  Conv2dGemm(const Conv2dRoutines& routines, const Conv2dGeometry& geometry, const Conv2dFusion& fusion = {});

  /// Any convolution but of an upsampled input and with gates in several groups.
  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept {
    return !fusion.upsamples() && !(fusion.gate && geometry.groups > 1);
  }

  [[nodiscard]] std::size_t packed_bytes() const noexcept;
  void pack(const float* weight, std::byte* packed) const;
  [[nodiscard]] std::size_t scratch_bytes() const noexcept;
  [[nodiscard]] double error_factor() const noexcept;
  [[nodiscard]] double macs() const noexcept;
  /// Runs at most as many threads as there were when scratch_bytes() was asked.
  void run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const;

 private:
  struct Task;
  [[nodiscard]] Task task(std::int64_t index) const noexcept;
  void run_task(const Task& task, const Conv2dArrays& arrays, float* memory) const;
  void write_tile(const Task& task, float* tile, const Conv2dArrays& arrays) const;

  const Conv2dRoutines& routines_;
  Conv2dGeometry g_;
  bool gated_;
  bool relu_input_;
  UnaryRow relu_;
  Conv2dEpilogue epilogue_;
  std::int64_t depth_;        // K
  std::int64_t block_depth_;  // products summed before they are added to the tile
  std::int64_t panels_;       // of weights, in a group
  std::int64_t task_panels_;  // of weights, in a task
  std::int64_t row_tasks_;    // tasks that share a tile of positions in a group
  std::int64_t tiles_;        // of positions
};

}  // namespace slide::ops
