#pragma once

#include <cstdint>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// Where the columns of a convolution's matrix come from: row k = (c, u, v) holds, for each output position
/// (i, j), x[c, i·stride_y + u·dilation_y - top, j·stride_x + v·dilation_x - left], zero outside.
struct ColumnSource {
  const float* x;  ///< first channel
  std::int64_t height, width;
  std::int64_t owidth;
  std::int64_t kheight, kwidth;
  std::int64_t stride_y, stride_x;
  std::int64_t dilation_y, dilation_x;
  std::int64_t top, left;
};

/// A depthwise filter over a plane that was padded and split into phases: output column j reads phase
/// offset % stride at offset / stride + j.
struct DepthwiseRow {
  const float* const* taps;  ///< for each tap where output column 0 reads
  const float* weight;       ///< for each tap
  std::int64_t count;        ///< of taps
  float bias;
};

/// Rows of up to four channels that become one row of words.
struct WordRow {
  const float* x[4];  ///< as many as the precision packs; null: zeros
  float zero, inverse_step;
  bool relu;  ///< numbers below zero count as zero
};

/// The inner loops of the convolutions, compiled once per instruction-set level.
struct Conv2dRoutines {
  Isa isa;
  bool fused;            ///< multiply and add round once
  std::int64_t rows;     ///< of a panel of the left matrix
  std::int64_t columns;  ///< of a panel of the right matrix

  /// c[m, j] += sum over k < depth of a[k·rows + m] · b[k·columns + j], for all m < row_count <= rows and j <
  /// column_count <= columns and perhaps others within the panel; the sum is taken in the order of k and then
  /// added. c has rows of `columns`, of which the panel's `rows` exist.
  void (*multiply)(const float* a, const float* b, std::int64_t depth, float* c, std::int64_t row_count,
                   std::int64_t column_count);

  /// Rows first_k <= k < last_k of the matrix above, positions first <= p < first + count <= first + columns,
  /// as rows of `columns` floats with zeros at the end.
  void (*pack_columns)(const ColumnSource& source, std::int64_t first, std::int64_t count,
                       std::int64_t first_k, std::int64_t last_k, float* b);

  // By Precision, words as conv2d_direct.h has them.

  /// multiply() with rows of b that lie anywhere: row k at b + offsets[k]. Sums of integers are int32 in the
  /// words of c. With `exact` nothing is read behind column_count.
  void (*multiply_at[3])(const float* a, const float* b, const std::int32_t* offsets, std::int64_t depth,
                         float* c, std::int64_t row_count, std::int64_t column_count, bool exact);

  /// y[j] = the word of x[start + j·stride] where that is in [0, width), else `outside`, for j < count.
  void (*fill_row[3])(const WordRow& x, std::int64_t width, std::int64_t start, std::int64_t stride,
                      float outside, float* y, std::int64_t count);

  /// The least and the largest of x[0...count), and 0.
  void (*range)(const float* x, std::int64_t count, float* low, float* high);

  /// y[j] = float(the int32 in y[j]) · step + bias.
  void (*dequantise)(float* y, std::int64_t count, float step, float bias);

  /// y[j] = elu(a[j]) · sigmoid(g[j]) for j < count. a and g are read up to a multiple of the vector width.
  void (*gate)(const float* a, const float* g, float* y, std::int64_t count);

  /// y[j] = bias + the taps' products in their order, for j < count. Taps are read up to a multiple of the
  /// vector width.
  void (*depthwise_row)(const DepthwiseRow& row, float* y, std::int64_t count);
};

/// A multiple of all levels' vector widths: rows that routines may read beyond their end are padded to it.
inline constexpr std::int64_t kRowAlignment = 16;

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const Conv2dRoutines* const> conv2d_routines();

}  // namespace slide::ops
