#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "ops/attention/attention_routines.h"
#include "ops/attention/contextual_attention_op.h"
#include "ops/conv2d/conv2d_gemm.h"

namespace slide::ops {

/// Contextual attention, one row of foreground positions (a strip) after the other, so that the n×n scores
/// are never stored: memory grows as n · columns. Rows of a strip's matrices are foreground positions,
/// columns background positions, the other way round than in the definition, so that softmax runs along
/// memory.
///
/// Scores of a strip are a convolution of the reduced background with the strip's patches as filters. Fusing
/// along rows needs the neighbours of a strip in the same order, and fusing along columns the strips above
/// and below (and, where the column-major order wraps, the first and the last strip), kept in a few slots.
/// The mixture of patches is a convolution, too: of each background channel with the strip's weights as a
/// dilated filter of the size of the grid of positions.
class AttentionStrips {
 public:
  AttentionStrips(const AttentionRoutines& routines, const Conv2dRoutines& conv,
                  const AttentionGeometry& geometry);

  [[nodiscard]] std::size_t scratch_bytes() const noexcept;
  /// With c_s the roundings that a score's products meet (convolution, norm, twice fusing, softmax_scale) the
  /// scores are off by c_s·u·E. Each weight then is off, relatively and in first order, by softmax_scale·(E +
  /// mean E) times c_s·u, by u times its exponent, which is at most softmax_scale·(E + mean E) + ln n (the
  /// largest score lies within ln n of the mean under the softmax), by 2u of exp, and by the roundings of the
  /// sum and the division. The mixture adds its convolution's factor. 1.1 stands for what is not of first
  /// order while c_s·u·softmax_scale·E is below 0.1.
  [[nodiscard]] double error_factor() const noexcept;
  /// fuse_weight may be null: the identity.
  void run(const float* foreground, const float* background, const float* mask, const float* fuse_weight,
           float* y, std::span<std::byte> scratch) const;

 private:
  struct Memory;
  /// The floats of each array of Memory, in their order.
  [[nodiscard]] std::array<std::int64_t, 10> sizes() const noexcept;
  [[nodiscard]] Memory memory(std::span<std::byte> scratch) const noexcept;
  static void convolve(const Conv2dGemm& method, const float* x, const float* weight, float* y,
                       std::span<std::byte> memory);
  void prepare(const float* foreground, const float* background, const float* mask, const float* fuse_weight,
               const Memory& m) const;
  void score_strip(std::int64_t row, float* fused, const Memory& m) const;
  void fuse_columns(std::int64_t row, const std::vector<const float*>& strips, const Memory& m) const;
  void softmax(const Memory& m) const;
  void paste(std::int64_t row, const float* background, float* y, const Memory& m) const;

  const AttentionRoutines& routines_;
  AttentionGeometry g_;
  std::int64_t n_;         // positions
  std::int64_t reach_;     // of the fuse kernel
  std::int64_t extended_;  // a strip and its neighbours in row-major order
  Conv2dGemm scores_;
  Conv2dGemm mixture_;
};

}  // namespace slide::ops
