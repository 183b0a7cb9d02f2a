#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "ops/attention/attention_routines.h"
#include "ops/attention/contextual_attention_op.h"
#include "ops/gemm/conv2d_gemm.h"

namespace slide::ops {

/// Contextual attention, one row of foreground positions (a strip) after the other, so that the n×n scores
/// are never stored: memory grows as n · columns. Rows of a strip's matrices are foreground positions,
/// columns background positions, the other way round than in the definition, so that softmax runs along
/// memory.
///
/// Patches that overlap share their products. The score of two patches is the sum, over the offsets within a
/// patch, of products of single pixels at equally moved positions: pixels are multiplied once (a matrix
/// product of depth C instead of C·patch²), and added along the columns, then along the rows. In the result
/// four patches overlap in every block of rate × rate pixels: their weights are added first, at equally moved
/// positions, and one product gives the block (rate² instead of 4·rate² pixels for each pair).
///
/// Positions inside the hole are not left out: as queries their results are part of the definition, and as
/// keys the fuse kernel carries their scores to neighbours.
class AttentionStrips {
 public:
  AttentionStrips(const AttentionRoutines& routines, const Conv2dRoutines& conv,
                  const AttentionGeometry& geometry);

  [[nodiscard]] std::size_t scratch_bytes() const noexcept;
  /// With c_s the roundings that a score's products meet (matrix product, sums along columns and rows, norm,
  /// twice fusing, softmax_scale) the scores are off by c_s·u·E, and their exponents by u more: what that
  /// does to the weights is in the error scale. Relative to a weight are 2u of exp and the roundings of the
  /// sum and the division. The mixture adds those of four weights and its matrix product's. 1.1 stands for
  /// what is of second order.
  [[nodiscard]] double error_factor() const noexcept;
  /// Of the two products and of fusing, if every strip is made once.
  [[nodiscard]] double macs() const noexcept;
  /// fuse_weight may be null: the identity.
  void run(const float* foreground, const float* background, const float* mask, const float* fuse_weight,
           float* y, std::span<std::byte> scratch) const;

 private:
  struct Memory;
  class HeldRows;
  struct Held;
  /// The floats of each array of Memory, in their order.
  [[nodiscard]] std::array<std::int64_t, 15> sizes() const noexcept;
  [[nodiscard]] Memory memory(std::span<std::byte> scratch) const noexcept;
  static void multiply(const Conv2dGemm& method, const float* x, const float* weight, float* y,
                       std::span<std::byte> memory);
  /// Powers of two that bring features of more than 2^40 down to about 1 for the products of pixels.
  struct Units {
    float foreground = 1, background = 1;
  };
  void prepare(const float* foreground, const float* background, const float* mask, const float* fuse_weight,
               const Units& units, const Memory& m) const;
  [[nodiscard]] Units units_of(const float* foreground, const float* background) const;
  void reduce(const float* foreground, const float* background, const Units& units, const Memory& m) const;
  void list_blocks(const float* background, const Memory& m) const;
  void line_strip(std::int64_t row, float* lines, const Memory& m) const;
  void score_strip(std::int64_t row, float* scores, HeldRows& lines, const Memory& m) const;
  void fuse_strip(std::int64_t row, float* fused, Held& held, const Memory& m) const;
  void fuse_columns(std::int64_t row, const std::vector<const float*>& strips, const Memory& m) const;
  void softmax(std::int64_t row, float scale, const Memory& m) const;
  void paste(std::int64_t block_row, float* y, const Memory& m) const;
  /// Weights of foreground position (row, x) over the background, with a column of zeros behind each row of
  /// positions and zeros before and behind.
  [[nodiscard]] float* weights_of(std::int64_t row, std::int64_t x, const Memory& m) const noexcept;

  const AttentionRoutines& routines_;
  AttentionGeometry g_;
  std::int64_t n_;           // positions
  std::int64_t margin_;      // around the positions of which single pixels are multiplied: of the patch
  std::int64_t line_width_;  // of the positions with their margin
  std::int64_t line_count_;  // of them all
  std::int64_t reach_;       // of the fuse kernel
  std::int64_t score_rows_;  // that row-major fusing of one needs
  std::int64_t weight_size_;
  std::int64_t blocks_;  // of rate × rate pixels
  Conv2dGemm pixels_;
  Conv2dGemm mixture_;
};

}  // namespace slide::ops
