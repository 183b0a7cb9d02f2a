#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "ops/conv2d/conv2d_geometry.h"
#include "ops/conv2d/conv2d_method.h"
#include "ops/conv2d/conv2d_routines.h"
#include "ops/conv2d/winograd/winograd_error.h"
#include "ops/conv2d/winograd/winograd_routines.h"
#include "runtime/precision.h"

namespace slide::ops {

/// Convolutions of 3x3 and stride 1 by Winograd's F(m×m, 3×3): tiles of m×m outputs, each from (m + 2)²
/// inputs that are transformed, multiplied frequency by frequency as matrices (oc × ic by ic × tiles), and
/// transformed back. See winograd_matrices.h. A dilation d makes d² undilated convolutions of its phases,
/// the pixels of equal coordinates modulo d, which are tiled like images and multiplied together.
///
/// Tiles are numbered line by line; a line is a row of tiles of one vertical phase, and within it adjacent
/// numbers are the horizontal phases of a tile, then the next tile. So at every dilation neighbours in
/// number are neighbours in memory.
///
/// Error: with n = m / 2 pairs of points, a product meets n roundings in each of the input's two transforms,
/// one of the transformed weight, those of its sum (blocks of block_depth channels, see Conv2dGemm), n + 1 in
/// each of the output's two and one of the bias; without fused multiply-add 2·n and n + 2 in a transform.
/// Bilinear upsampling adds one rounding in each direction, two without fused multiply-add.
/// They are relative to
///   s = |Aᵀ| [(|G| |w| |Gᵀ|) ⊙ (|Bᵀ| |x| |B|) summed over the channels] |A| + |b|
/// (error_scale()), not to |w| ∗ |x|: |y - y64| <= c·u·s. Sums of large numbers of both signs may come out
/// worse than from a direct convolution, and an infinite or NaN input spoils its tile (Reach::kImage). Of
/// normal random inputs and weights, RMS error relative to the result's RMS, in 1e-7:
///
///   channels                       16   64  256  512
///   direct, summed in order       2.2  4.3  8.5   12
///   Conv2dGemm                    1.1  1.3  1.8  2.1
///   F(2)                          1.4  1.6  2.0  2.4
///   F(4)                          4.3  4.9  6.2  7.3
///   F(4) with 0, ±1, ±2, ∞        8.7   10   13   13
///   F(6)                           19   21   26   31
class Conv2dWinogradBase {
 public:
  [[nodiscard]] std::size_t packed_bytes() const noexcept;
  void pack(const float* weight, std::byte* packed) const;
  [[nodiscard]] std::size_t scratch_bytes() const noexcept;
  [[nodiscard]] double error_factor() const noexcept;
  [[nodiscard]] double macs() const noexcept;
  /// Runs at most as many threads as there were when scratch_bytes() was asked.
  void run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const;

 protected:
  /// Precision: kFp32, or kBf16 with tiles of 2 or 4.
  Conv2dWinogradBase(int tile, Precision precision, const Conv2dRoutines& routines,
                     const Conv2dGeometry& geometry, const Conv2dFusion& fusion);
  /// Whether it can, and is worth it: enough channels and tiles.
  [[nodiscard]] static bool pays(int tile, const Conv2dGeometry& geometry,
                                 const Conv2dFusion& fusion) noexcept;

 private:
  /// Tiles that are transformed together.
  struct Strip {
    std::int64_t image;
    std::int64_t first_line, last_line;
    std::int64_t first_tile;  // in each of them
    std::int64_t line_tiles;
    std::int64_t panels;                          // of tiles
    std::int64_t panel_stride, frequency_stride;  // of V: [frequency][panel][channel][column]

    [[nodiscard]] std::int64_t tiles() const noexcept { return (last_line - first_line) * line_tiles; }
  };
  static constexpr std::int64_t kPackedWords = 16;  // transformed together: in the first-level cache
  // Of all frequencies, what is multiplied before the next words are transformed: in the second-level cache.
  static constexpr std::int64_t kLateWords = 64;
  /// Adjacent tiles of one line and one panel, and the filters of a task.
  struct Run {
    std::int64_t image;
    std::int64_t row;                        // the first output row
    std::int64_t first, last;                // in the line
    std::int64_t first_filter, last_filter;  // rows of the packed weights
  };
  void divide_tiles() noexcept;
  void choose_order() noexcept;
  [[nodiscard]] std::int64_t strips() const noexcept;
  [[nodiscard]] Strip strip(std::int64_t index) const noexcept;
  [[nodiscard]] std::int64_t tasks_of(std::int64_t tile_panels) const noexcept;
  [[nodiscard]] std::int64_t v_size() const noexcept;
  [[nodiscard]] std::int64_t products_size() const noexcept;
  /// Floats that threads share.
  [[nodiscard]] std::int64_t shared_size() const noexcept {
    return v_size() + (few_tiles_ ? products_size() : 0);
  }
  [[nodiscard]] std::int64_t work_size() const noexcept;
  [[nodiscard]] std::int64_t late_stride() const noexcept;
  [[nodiscard]] std::int64_t late_size() const noexcept;
  void run_strip(const Strip& strip, const Conv2dArrays& arrays, float* v, float* memory,
                 std::int64_t slots) const;
  void pack_taps(const float* weight, std::int64_t panel, float* packed) const;
  void list_taps(const float* weight, std::int64_t first_row, std::int64_t first_channel,
                 std::int64_t channels, float* taps) const;
  void transform_channels(const Strip& strip, std::int64_t word, const Conv2dArrays& arrays, float* v,
                          float* memory) const;
  void run_task(const Strip& strip, std::int64_t index, const Conv2dArrays& arrays, const float* v,
                float* memory) const;
  [[nodiscard]] const float* residual_ahead(const Strip& strip, std::int64_t panel, std::int64_t first_filter,
                                            std::int64_t frequency, const Conv2dArrays& arrays) const;
  void run_few_tiles(const Strip& strip, const Conv2dArrays& arrays, const float* v, float* products,
                     float* memory, std::int64_t slots) const;
  void multiply_frequency(const Strip& strip, std::int64_t frequency, std::int64_t first_panel,
                          std::int64_t last_panel, const std::byte* packed, const float* v, float* products,
                          float* memory) const;
  void multiply_late(const Strip& strip, std::int64_t panel, const std::byte* packed, const float* v,
                     float* products, float* memory) const;
  void transform_panel(const Strip& strip, std::int64_t panel, std::int64_t first_filter,
                       std::int64_t last_filter, const float* products, const Conv2dArrays& arrays,
                       float* sums) const;
  void transform_filters(const Run& run, const float* products, const Conv2dArrays& arrays,
                         float* sums) const;
  void join_phases(const float* phases, std::int64_t count, float* columns) const;
  void write_filter(const Run& run, std::int64_t row, float* sums, const Conv2dArrays& arrays) const;

  const Conv2dRoutines& routines_;
  const WinogradRoutines& winograd_;
  const WinogradMultiplier& multiplier_;
  const WinogradTransforms& transforms_;
  Precision precision_;
  Upsampling upsampling_;  // of the first channels
  std::int64_t joined_;    // the last channels, which are not upsampled
  Conv2dGeometry g_;
  bool gated_, relu_input_;
  bool finishes_rows_;  // the output transform does, with residual and clamp
  bool non_temporal_;   // ... in stores that bypass the caches
  bool residual_last_;
  bool few_tiles_;  // filters are lanes of products, and all products are kept
  bool late_;       // ... and the weights, which are many, transformed by each run
  bool shared_;     // all threads work on a strip, else each on its own
  Conv2dEpilogue epilogue_;
  int tile_;                  // m
  std::int64_t frequencies_;  // (m + 2)²
  WinogradPoints points_;
  std::int64_t lanes_;         // channels of a word
  std::int64_t words_;         // of a tile's frequency
  std::int64_t block_depth_;   // words of float32 summed before they are added to the sum
  std::int64_t columns_;       // of a panel of tiles
  std::int64_t panel_rows_;    // filters of a panel of weights
  std::int64_t part_depth_;    // words that are multiplied with all rows before the next; whole blocks
  std::int64_t lines_;         // of tiles in an image
  std::int64_t line_tiles_;    // of a line, or of its segment
  std::int64_t phase_size_;    // columns of a panel of tiles, as phases of rows of sums are padded
  std::int64_t segments_;      // of a line
  std::int64_t strip_lines_;   // lines transformed together; 1 if they have segments
  std::int64_t strip_panels_;  // their panels of tiles
  std::int64_t panels_;        // of weights
  std::int64_t task_panels_;   // of weights, in a task
  std::int64_t task_columns_;  // panels of tiles in a task
  // Floats of products: from frequency to frequency of a filter, and of a filter with the tiles of a panel
  // or, if they are few, with all.
  std::int64_t product_stride_, product_row_;
};

/// The square of the largest sum of a row of |Bᵀ|: what the input's transform may magnify.
constexpr double winograd_input_growth(int tile) noexcept { return tile == 2 ? 4 : tile == 4 ? 16 : 121; }

/// Tile: 2, 4 or 6.
template <int Tile>
class Conv2dWinograd : public Conv2dWinogradBase {
 public:
  static constexpr double kInputGrowth = winograd_input_growth(Tile);
  static constexpr Precision kPrecision = Precision::kFp32;
  Conv2dWinograd(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                 const Conv2dFusion& fusion = {})
      : Conv2dWinogradBase(Tile, kPrecision, routines, geometry, fusion) {}

  /// 3x3, stride 1, one group, and channels and tiles enough to be worth it.
  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept;
  /// Whether it fits and is faster than direct convolution with bfloat16.
  [[nodiscard]] static bool beats_lower(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept;

  /// s above and what underflow adds, for each sum; inputs F64: x (as it is convolved), weight, perhaps bias.
  static void error_scale(const Conv2dGeometry& g, std::span<const Tensor> inputs, std::span<double> scale) {
    winograd_error_scale(Tile, g, inputs, scale);
  }
};

/// Tile: 2 or 4. Transformed weights and inputs are rounded to bfloat16; sums and transforms are float32.
/// Weights that are transformed by each run were rounded before, too. The transforms magnify what the
/// roundings do: of normal random inputs and weights the RMS error of F(4) is 1.2 %, of rectified ones 1.0 %,
/// five and four times that of a direct convolution in bfloat16 and as that of one with 8-bit integers; that
/// of F(2) is 0.42 and 0.37 %. They multiply a quarter and four ninths as often.
template <int Tile>
class Conv2dWinogradBf16 : public Conv2dWinogradBase {
 public:
  static constexpr double kInputGrowth = winograd_input_growth(Tile);
  static constexpr Precision kPrecision = Precision::kBf16;
  Conv2dWinogradBf16(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                     const Conv2dFusion& fusion = {})
      : Conv2dWinogradBase(Tile, kPrecision, routines, geometry, fusion) {}

  /// Where it is worth it in float32, with channels enough for the products to be most of the work; F(2) only
  /// where weights are transformed by each run.
  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept;
  /// Whether it is faster than direct convolution with 8-bit integers, which is not more exact: with more
  /// channels and tiles yet.
  [[nodiscard]] static bool replaces_lower(const Conv2dGeometry& geometry) noexcept;

  static void error_scale(const Conv2dGeometry& g, std::span<const Tensor> inputs, std::span<double> scale) {
    winograd_error_scale(Tile, g, inputs, scale);
  }
};

}  // namespace slide::ops
