#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "ops/conv2d/conv2d_method.h"
#include "ops/conv2d/conv2d_routines.h"
#include "ops/pointwise/unary_row.h"
#include "runtime/precision.h"

namespace slide::ops {

/// A convolution as a product of matrices whose right side is never made. The input is copied once into
/// padded planes, split by the stride (rows and columns 0, s, 2s, ..., then 1, s + 1, ...). Then, if output
/// positions are counted along the padded rows, tap (c, u, v) of the positions p, p + 1, ... lies at
/// offset(c, u, v) + p, + 1, ...: a run of adjacent numbers for every tap. The positions in the padding are
/// computed, too, and dropped. A 1×1 convolution in float32 needs no copy.
///
/// An element of a plane is a 32-bit word: one float32, two bfloat16 (of two channels) or four 8-bit integers
/// (of four channels), so that all precisions share the loops.
///
/// The 3×3 convolution of an image upsampled by 2 is four convolutions 2×2 of the small image, one for each
/// parity of row and column, their weights sums of the nine: 16 products where the definition has 36.
///
/// Integers: activations are round(x / step) + zero in 0...255 for the range of the tensor (calibrated, or
/// measured at each run) with 0 kept exact, weights are round(w / step) in -127...127 with a step for each
/// output channel. Their sum is exact.
class Conv2dDirect {
 public:
  static constexpr Precision kPrecision = Precision::kFp32;
  Conv2dDirect(const Conv2dRoutines& routines, const Conv2dGeometry& geometry, const Conv2dFusion& fusion,
               Precision precision = Precision::kFp32);

  /// float32: where few positions lie in the padding.
  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept;

  [[nodiscard]] std::size_t packed_bytes() const noexcept;
  void pack(const float* weight, std::byte* packed) const;
  [[nodiscard]] std::size_t scratch_bytes() const noexcept;
  /// In units of the precision's roundoff; integers: 1.
  [[nodiscard]] double error_factor() const noexcept;
  [[nodiscard]] double macs() const noexcept;
  /// Runs at most as many threads as there were when scratch_bytes() was asked.
  void run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const;

 private:
  struct Task;
  struct Quantiser {
    float step = 1, zero = 0;
  };
  [[nodiscard]] std::int64_t planes_size() const noexcept;
  [[nodiscard]] std::int64_t task_count() const noexcept;
  [[nodiscard]] Task task(std::int64_t index) const noexcept;
  [[nodiscard]] double weight_at(const float* weight, std::int64_t filter, std::int64_t channel, int variant,
                                 std::int64_t tap) const noexcept;
  [[nodiscard]] float pack_word(const float* weight, std::int64_t filter, std::int64_t k, int variant,
                                float step) const;
  [[nodiscard]] Quantiser quantiser(const Conv2dArrays& arrays) const;
  void fill_plane(std::int64_t index, const Conv2dArrays& arrays, const Quantiser& quantiser,
                  float* planes) const;
  void run_task(const Task& task, const Conv2dArrays& arrays, const Quantiser& quantiser, const float* planes,
                float* tile) const;
  void run_panel(const Task& task, const Conv2dArrays& arrays, const Quantiser& quantiser, std::int64_t panel,
                 std::int64_t k, const float* b, float* tile) const;
  void write_tile(const Task& task, const Conv2dArrays& arrays, float* tile) const;
  [[nodiscard]] bool writes_y() const noexcept;
  void write_row(const Task& task, const Conv2dArrays& arrays, std::int64_t channel, float* sums,
                 std::int64_t first, std::int64_t count) const;

  const Conv2dRoutines& routines_;
  Conv2dGeometry g_;
  Precision precision_;
  bool gated_, upsampled_, relu_input_;
  bool in_place_;  // the planes are x
  Conv2dEpilogue epilogue_;
  bool residual_;
  std::int64_t in_height_, in_width_;    // of x
  std::int64_t rows_out_, columns_out_;  // of output positions, for one variant
  std::int64_t taps_;                    // of one input channel
  std::int64_t lanes_;                   // channels of a word
  std::int64_t group_words_;             // words of a position, in a group
  std::int64_t plane_width_, plane_size_;
  std::int64_t depth_, block_depth_;  // words
  std::int64_t panels_;               // of weights, in a group
  std::int64_t task_panels_, row_tasks_;
  std::int64_t task_columns_, tiles_;  // positions of a task; tasks along the positions
  int variants_;
  std::vector<std::int32_t> offsets_;  // of each variant's words, from the group's first plane
};

/// The methods of lower precision, as conv2d_method.h has them.
class Conv2dDirectBf16 : public Conv2dDirect {
 public:
  static constexpr Precision kPrecision = Precision::kBf16;
  Conv2dDirectBf16(const Conv2dRoutines& routines, const Conv2dGeometry& geometry, const Conv2dFusion& fusion)
      : Conv2dDirect(routines, geometry, fusion, Precision::kBf16) {}
  /// Not where Winograd's F(4) in float32 does a quarter of the multiplications: it is as fast and more
  /// exact.
  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept;
};

class Conv2dDirectInt8 : public Conv2dDirect {
 public:
  static constexpr Precision kPrecision = Precision::kInt8;
  Conv2dDirectInt8(const Conv2dRoutines& routines, const Conv2dGeometry& geometry, const Conv2dFusion& fusion)
      : Conv2dDirect(routines, geometry, fusion, Precision::kInt8) {}
  /// Not the first layers, whose words would be half empty and whose errors all others inherit.
  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept;
  /// What quantisation may do to the sums, with the range measured:
  ///   (|x| + step_x / 2) ∗ (|w| + step_w / 2) - |x| ∗ |w|, and float32 roundings.
  static void error_scale(const Conv2dGeometry& g, std::span<const Tensor> inputs, std::span<double> scale);
};

}  // namespace slide::ops
