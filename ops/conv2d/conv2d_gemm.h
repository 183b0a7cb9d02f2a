#pragma once

#include <cstddef>
#include <span>

#include "ops/conv2d/conv2d_geometry.h"
#include "ops/conv2d/conv2d_routines.h"

namespace slide::ops {

/// A convolution as a product of matrices, weight (oc × K) by columns (K × positions), K = ic/groups·kh·kw,
/// in tiles: a task takes one tile of positions (a panel of the routines) and a run of output channels. It
/// goes through K in blocks; of each it packs the columns, multiplies them with all its weights and adds the
/// result to the tile. So scratch memory holds the packed weights and a tile for each thread, never the
/// columns of an image.
///
/// Error: an output is the sum of its blocks, and a block the sum of its products in order, so no product
/// meets more than block_depth + blocks roundings. With blocks of K^½ products this is 2·K^½, and it is a
/// bound, not an expectation: it holds for all-equal and for cancelling terms alike.
class Conv2dGemm {
 public:
  /// `gated`: see gated_conv2d(); one group.
  Conv2dGemm(const Conv2dRoutines& routines, const Conv2dGeometry& geometry, bool gated = false);

  /// Any convolution.
  [[nodiscard]] static bool fits(const Conv2dGeometry& /*geometry*/) noexcept { return true; }

  [[nodiscard]] std::size_t scratch_bytes() const noexcept;
  /// The number of roundings a product meets, c in |y - y64| <= c·u·(|w| ∗ |x| + |b|).
  [[nodiscard]] double error_factor() const noexcept;
  /// bias may be null. y has the convolution's shape, or half the channels if gated. Runs at most as many
  /// threads as there were when scratch_bytes() was asked.
  void run(const float* x, const float* weight, const float* bias, float* y,
           std::span<std::byte> scratch) const;

 private:
  struct Task;
  [[nodiscard]] Task task(std::int64_t index) const noexcept;
  [[nodiscard]] std::int64_t channel_of_row(std::int64_t group, std::int64_t row) const noexcept;
  void pack_weight(const float* weight, float* packed) const;
  void run_task(const Task& task, const float* x, const float* packed, const float* bias, float* y,
                float* memory) const;
  void write_tile(const Task& task, const float* tile, float* y) const;

  const Conv2dRoutines& routines_;
  Conv2dGeometry g_;
  bool gated_;
  std::int64_t depth_;        // K
  std::int64_t block_depth_;  // products summed before they are added to the tile
  std::int64_t panels_;       // of weights, in a group
  std::int64_t task_panels_;  // of weights, in a task
  std::int64_t row_tasks_;    // tasks that share a tile of positions in a group
  std::int64_t tiles_;        // of positions
};

}  // namespace slide::ops
