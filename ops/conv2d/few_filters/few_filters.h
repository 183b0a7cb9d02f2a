#pragma once

#include <cstddef>
#include <span>

#include "ops/conv2d/conv2d_geometry.h"
#include "ops/conv2d/conv2d_method.h"
#include "ops/conv2d/conv2d_routines.h"

namespace slide::ops {

/// A convolution of at most four filters, which has to read much for each product: what counts is to read the
/// input once, in its order, and without copying it. A task takes a band of output rows, whose sums stay in
/// the first-level cache while the channels stream by, some of them at a time, the next ones being fetched
/// meanwhile. A tile of rows shares each vector of the input that it loads (few_filters_kernels.h); rows
/// above and below the image are a row of zeros, what lies beside it is masked. A 1×1 convolution has no
/// rows: its bands are runs of pixels.
///
/// Error: a block, the products of the channels at a time, is summed in order, then the bias and the blocks:
/// no product meets more roundings than it has terms and there are blocks. Blocks have about the root of all
/// products.
class Conv2dFewFilters {
 public:
  static constexpr Precision kPrecision = Precision::kFp32;
  Conv2dFewFilters(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                   const Conv2dFusion& fusion = {});

  /// At most four filters, each of at least two channels, one group, stride 1, a kernel of 3, 5 or 7 rows or
  /// of 1×1; nothing but a residual and an activation fused.
  [[nodiscard]] static bool fits(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept;
  /// Whether plans of lower precision take it, too: a single filter waits for its input, which lower
  /// precision reads as slowly and has to round.
  [[nodiscard]] static bool beats_lower(const Conv2dGeometry& geometry, const Conv2dFusion& fusion) noexcept {
    return geometry.oc == 1 && fits(geometry, fusion);
  }

  /// Channel by channel, column by column, the taps of all filters.
  [[nodiscard]] std::size_t packed_bytes() const noexcept;
  void pack(const float* weight, std::byte* packed) const;
  [[nodiscard]] std::size_t scratch_bytes() const noexcept;
  [[nodiscard]] double error_factor() const noexcept;
  [[nodiscard]] double macs() const noexcept;
  /// Runs at most as many threads as there were when scratch_bytes() was asked.
  void run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const;

 private:
  struct Band {
    std::int64_t image;
    std::int64_t row, column, count;  // the first output position, and how many columns
  };
  struct Span {  // of a plane
    std::int64_t first, last;
  };
  [[nodiscard]] std::int64_t band_count() const noexcept;
  [[nodiscard]] Band band(std::int64_t index) const noexcept;
  [[nodiscard]] std::int64_t zeros_size() const noexcept;
  [[nodiscard]] std::int64_t thread_size() const noexcept;
  [[nodiscard]] Span span_of(const Band& band) const noexcept;
  [[nodiscard]] FilterAhead ahead_of(const Band& now, const Band& next, std::int64_t channel,
                                     const Conv2dArrays& arrays) const noexcept;
  void add_tile(const Band& band, std::int64_t phase, const float* x, const float* zeros,
                FilterTile& tile) const;
  void write_band(const Band& band, const Conv2dArrays& arrays, float* sums) const;
  void run_band(std::int64_t index, const Conv2dArrays& arrays, const float* zeros, float* sums) const;

  const Conv2dRoutines& routines_;
  Conv2dGeometry g_;
  Conv2dEpilogue epilogue_;
  std::int64_t block_channels_;  // summed before they are added to the sums
  std::int64_t tile_rows_;       // of the output, dilation_y apart
  std::int64_t phases_;          // of the dilation: tiles of a band
  std::int64_t band_rows_;
  std::int64_t band_columns_, column_bands_;  // of a row
  std::int64_t sum_step_;                     // from row to row of sums
};

}  // namespace slide::ops
