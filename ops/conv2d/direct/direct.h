#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "ops/common/elements.h"
#include "ops/conv2d/conv2d_method.h"
#include "ops/conv2d/conv2d_routines.h"
#include "ops/pointwise/unary_row.h"
#include "ops/resize/resize_routines.h"
#include "runtime/precision.h"

namespace slide::ops {

/// A convolution as a product of matrices whose right side is made in pieces that stay in the cache.
///
/// The input is copied into padded planes, split by the stride (rows and columns 0, s, ..., then 1, s + 1,
/// ...). Then tap (c, u, v) of neighbouring output positions of a row is a run of adjacent numbers, at
/// offset(c, u, v) behind the same run of tap (0, 0, 0). Many filters share a panel: a block of the depth,
/// for some positions, which stays in the first-level cache while all filters are multiplied by it. Where
/// rows are long, panels end where they do, and the runs are multiplied where they lie; short rows are
/// gathered into a buffer. Few filters go along the rows with planes of a block of the depth (streaming). A
/// 1×1 convolution without padding gathers from the input itself. Where the planes of one group's strip of
/// rows are small, each task makes them for itself, and they stay in the second-level cache; else all are
/// made first.
///
/// An element of a plane is a 32-bit word: one float32, two bfloat16 (of two channels) or four 8-bit integers
/// (of four channels), so that all precisions share the loops. Tiles take many words of the depth at once,
/// from gathered panels alone.
///
/// The 3×3 convolution of an image upsampled by 2 is four convolutions 2×2 of the small image, one for each
/// parity of row and column, their weights sums of the nine: 16 products where the definition has 36.
///
/// Integers: activations are round(x / step) + zero in 0...255 for the range of the tensor (calibrated, or
/// measured at each run) with 0 kept exact, weights are round(w / step) in -127...127 with a step for each
/// output channel. Their sum is exact, also where an instruction adds products in pairs and saturates at 16 bits
/// (Conv2dRoutines::splits_pairs): two weights w of one sign that are multiplied by neighbouring activations give no
/// more than 255·128 < 2^15 if their magnitudes add up to 128 at most, two of different signs never do. Of larger ones
/// the excess becomes an entry of its own, with the same activations, and the sums are the same integers. Where too many
/// weights are so large, a panel has none and is multiplied by other instructions.
class Conv2dDirect {
 public:
  static constexpr Precision kPrecision = Precision::kFp32;
  Conv2dDirect(const Conv2dRoutines& routines, const Conv2dGeometry& geometry, const Conv2dFusion& fusion,
               Precision precision = Precision::kFp32);

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
  static constexpr std::size_t kTilePanels = 12;  // of columns, at most
  struct Task {
    std::int64_t image, group;
    int variant;
    std::int64_t first_panel, last_panel;  // of weights
    std::int64_t first_row;                // of the strip
    std::int64_t first, count;             // positions in the strip
  };
  struct Quantiser {
    float step = 1, zero = 0;
    std::vector<std::uint8_t> spoiled;  ///< of each image: 1 where it holds a NaN or an infinity
  };
  struct Call {
    const Conv2dArrays& arrays;
    Quantiser quantiser;
    float *starts, *steps, *biases;  // of each row
    const float* planes;             // shared
  };
  void choose_tasks();
  void list_offsets();
  [[nodiscard]] std::int64_t filled(std::int64_t depth) const noexcept;
  [[nodiscard]] std::int64_t strip_planes() const noexcept;
  [[nodiscard]] std::int64_t shared_planes() const noexcept;
  [[nodiscard]] std::int64_t rows_size() const noexcept;
  [[nodiscard]] std::int64_t thread_size() const noexcept;
  [[nodiscard]] std::int64_t task_count() const noexcept;
  [[nodiscard]] Task task(std::int64_t index) const noexcept;
  [[nodiscard]] double weight_at(const float* weight, std::int64_t filter, std::int64_t channel, int variant,
                                 std::int64_t tap) const noexcept;
  [[nodiscard]] float pack_word(const float* weight, std::int64_t filter, std::int64_t k, int variant,
                                float step) const;
  void pack_panel(const float* weight, std::int64_t panel, float* panels, float* steps, float* sums) const;
  [[nodiscard]] std::int64_t rest_entries() const noexcept;
  [[nodiscard]] std::int64_t rest_size() const noexcept;
  [[nodiscard]] std::int64_t words_at(std::int64_t panel, std::int64_t k) const noexcept;
  [[nodiscard]] std::int64_t rests_at(std::int64_t panel, std::int64_t k) const noexcept;
  void split_pairs(float* words, std::int64_t depth, std::int32_t* rests) const;
  [[nodiscard]] Quantiser quantiser(const Conv2dArrays& arrays) const;
  void make_row_values(const Call& call) const;
  void spoil(const Call& call) const;
  void fill_plane(const Call& call, std::int64_t index, std::int64_t first_row, std::int64_t rows,
                  float* plane) const;
  void run_gathered(const Call& call, const Task& task, float* memory) const;
  struct Columns {  // of a panel: positions, and their words
    std::int64_t first, count;
    const float* b;
    const std::int32_t* offsets;
  };
  struct Block {  // of the depth: what all panels of a task have in common
    std::int64_t depth;
    bool first, last, to_y;
    std::int64_t y_stride, row;  // of panel 0
    std::int64_t at;             // of panel 0 and the strip, in y
    const float* a;              // of panel 0
    const std::int32_t* rests;   // of panel 0; null if nothing is split
  };
  struct Ahead {  // rows of x that are gathered next: each product fetches one
    const float* x = nullptr;
    std::int64_t count = 0, rows = 0;
  };
  [[nodiscard]] std::int64_t panel_columns(std::int64_t first, std::int64_t last) const noexcept;
  void find_words(const Call& call, const Task& task, std::int64_t k, const float* planes, float* gathered,
                  Columns& columns) const;
  void gather_panel(const Call& call, const Task& task, std::int64_t first, std::int64_t count,
                    std::int64_t k, const float* planes, float* b) const;
  void gather_words(const Call& call, const Task& task, std::int64_t first, std::int64_t count,
                    std::int64_t k, const float* planes, float* b) const;
  void run_streaming(const Call& call, const Task& task, float* memory) const;
  [[nodiscard]] Block block(const Call& call, const Task& task, std::int64_t k) const noexcept;
  void multiply(const Call& call, const Task& task, const Block& block, std::int64_t panel,
                const Columns& columns, float* sums, const Ahead& ahead) const;
  [[nodiscard]] Ahead ahead_of(const Call& call, const Task& t, std::int64_t first,
                               std::int64_t k) const noexcept;
  [[nodiscard]] bool writes_y() const noexcept;
  void write_rows(const Call& call, const Task& task, std::int64_t panel, std::int64_t first,
                  std::int64_t count, float* sums) const;
  void write_upsampled(const Call& call, const Task& task, std::int64_t plane, std::int64_t first,
                       std::int64_t count, float* sums) const;

  const Conv2dRoutines& routines_;
  Conv2dGeometry g_;
  Precision precision_;
  bool gated_, upsampled_, relu_input_, residual_last_;
  float least_;  // of x, where x is cut
  Conv2dEpilogue epilogue_;
  std::int64_t in_height_, in_width_;    // of x
  std::int64_t rows_out_, columns_out_;  // of output positions, for one variant
  std::int64_t taps_;                    // of one input channel
  std::int64_t lanes_;                   // channels of a word
  std::int64_t group_words_;             // words of a position, in a group
  std::int64_t depth_, block_depth_;     // words
  std::int64_t panels_;                  // of weights, in a group
  int variants_;
  bool in_place_;   // words are made from x, there are no planes
  bool in_rows_;    // panels end where rows do, and are multiplied where they lie
  bool streaming_;  // ... by few filters: planes are made for a block of the depth
  bool local_;      // each task fills the planes it needs
  bool fetches_;    // rows of x are fetched before they are gathered: they lie far away
  std::int64_t reach_y_, plane_width_;
  std::int64_t strip_rows_, strips_;     // output rows of the planes
  std::int64_t plane_size_;              // of a strip's rows
  std::int64_t tile_positions_;          // that share what is read of the weights
  std::int64_t task_positions_, tiles_;  // of a strip
  std::int64_t task_panels_, row_tasks_;
  std::vector<std::int32_t> offsets_;  // of each variant's words, from the group's first plane
  std::vector<std::int8_t> phase_is_read_;
};

/// A direct convolution in a lower precision. An image that is upsampled bilinearly is so first, into memory
/// of its own, and joined channels are copied behind it: the roundings of that are small beside those of
/// words.
class Conv2dDirectLow : public Conv2dDirect {
 public:
  Conv2dDirectLow(const Conv2dRoutines& routines, const Conv2dGeometry& geometry, const Conv2dFusion& fusion,
                  Precision precision);
  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept;
  [[nodiscard]] double error_factor() const noexcept;
  [[nodiscard]] std::size_t scratch_bytes() const noexcept;
  void run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const;

 private:
  Precision precision_;
  Nchw image_;  // before it is upsampled; of no planes if it is not
  std::int64_t joined_;
  const ResizeRoutines& resize_;
};

/// The methods of lower precision, as conv2d_method.h has them.
class Conv2dDirectBf16 : public Conv2dDirectLow {
 public:
  static constexpr Precision kPrecision = Precision::kBf16;
  Conv2dDirectBf16(const Conv2dRoutines& routines, const Conv2dGeometry& geometry, const Conv2dFusion& fusion)
      : Conv2dDirectLow(routines, geometry, fusion, Precision::kBf16) {}
  /// Not where float32 is as fast and more exact: where Winograd's F(4) does a quarter of the
  /// multiplications, and where a single filter waits for its input; nor behind bilinear upsampling, where
  /// Winograd's is faster.
  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept;
  /// With tiles: nothing else is as fast, but float32 for a single filter.
  [[nodiscard]] static bool fits_tiles(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept;
};

class Conv2dDirectInt8 : public Conv2dDirectLow {
 public:
  static constexpr Precision kPrecision = Precision::kInt8;
  Conv2dDirectInt8(const Conv2dRoutines& routines, const Conv2dGeometry& geometry, const Conv2dFusion& fusion)
      : Conv2dDirectLow(routines, geometry, fusion, Precision::kInt8) {}
  /// Not the first layers, whose words would be half empty and whose errors all others inherit, nor a
  /// single filter.
  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept;
  /// What quantisation may do to the sums, with the range measured:
  ///   (|x| + step_x / 2) ∗ (|w| + step_w / 2) - |x| ∗ |w|, and float32 roundings.
  /// x: what the range was measured of, before it was upsampled bilinearly.
  static void error_scale(const Conv2dGeometry& g, std::span<const Tensor> inputs, const Tensor& x,
                          std::span<double> scale);
};

}  // namespace slide::ops
