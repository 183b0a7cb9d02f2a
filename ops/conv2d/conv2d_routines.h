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

/// A depthwise filter over padded planes split by the stride: tap t of output position p is x[offsets[t] +
/// p].
struct DepthwiseRow {
  const float* x;
  const std::int32_t* offsets;
  const float* weight;
  std::int64_t count;  ///< of taps
  float bias;
  float low, high;  ///< to which results are cut
};

/// Taps of one column of a depthwise filter, in rows that follow each other, over a plane without borders.
struct DepthwiseRun {
  std::int32_t offset;  ///< of the first tap's position for output position 0
  std::int32_t weight;  ///< of the first tap
  std::int32_t taps;    ///< 1 to 5
  const float* mask;    ///< by position within step_rows rows: words of ones where the column is inside;
                        ///< null if another run of this column follows
};

/// A depthwise filter over planes whose rows are as long as the output's and follow each other without a gap,
/// with zeros above and below.
struct DepthwisePlane {
  const float* x;
  std::int64_t width, count;  ///< of rows, of all output positions
  std::int64_t step_rows;     ///< 1, 2 or 4: what whole vectors fill best
  const DepthwiseRun* runs;
  std::int64_t run_count;
  const float* weight;
  std::int64_t weight_step;  ///< from tap to tap of a run
  float bias;
  float low, high;  ///< to which results are cut
};

/// A block of the depth of a product of words (direct/direct.h) for a panel of rows and one of columns.
struct WordProduct {
  const float* a;               ///< depth × rows, as Conv2dRoutines::tile_depth says
  const float* b;               ///< row k at b + offsets[k], without offsets at b + k·columns
  const std::int32_t* offsets;  ///< may be null
  std::int64_t depth;
  std::int64_t row_count, column_count;  ///< b is read up to a multiple of the vector width
  bool first, last;                      ///< of the blocks
  /// Int32, where Conv2dRoutines::splits_pairs says so: for each row the end of its entries, each k and the
  /// word that is added to a's word k of the row; or, if the first end is negative, no entries.
  const std::int32_t* rests;
  const float* start;  ///< for each row the word that its sums start from, or end with
  float* sums;         ///< what a block leaves for the next; rows of `columns`
  const float* step;   ///< in the last block, integers: y = sum · step + bias for each row
  const float* bias;
  const float* residual;  ///< in the last block: added, laid out like y; may be null
  bool residual_last;     ///< ... behind the cut
  float low, high;        ///< to which results are cut
  float* y;               ///< in the last block
  std::int64_t y_stride;  ///< from row to row; nothing is written behind row_count and column_count
  const float* ahead;     ///< ahead_count numbers that will be wanted soon, and are fetched
  std::int64_t ahead_count;
};

/// Channels that become words, as many to a word as the precision packs, each plane_size behind the one
/// before. 8-bit integers are round(x · inverse_step + zero).
struct WordSource {
  const float* x;
  std::int64_t plane_size;
  std::int64_t channels;  ///< lanes behind the last are zeros
  float zero, inverse_step;
  float least;  ///< what numbers below it count as: 0 or -infinity
};

/// Rows that become rows of padded planes.
struct WordRows {
  std::int64_t rows, x_step, y_step;  ///< from row to row
  std::int64_t width, start, stride;
  std::int64_t count;
  float outside;
};

/// Neighbouring positions: their words, from x[from + j·stride], are b[to + j] for j < count.
struct WordRun {
  std::int64_t from, to, count;
};

/// The rows of a panel of columns: word k is of the channels at source.x + offsets[k].
struct WordGather {
  WordSource source;
  const std::int32_t* offsets;
  const WordRun* runs;  ///< by rising `to`
  std::int64_t run_count, stride;
};

/// Runs of numbers that will be wanted soon.
struct FilterAhead {
  const float* x;
  std::int64_t count, part;  ///< of a run; how many of it are fetched at each kRowAlignment positions
  std::int64_t runs, step;   ///< from run to run
};

/// Some channels of a convolution of few filters, for a tile of output rows: those of output row k and tap
/// row u are the tile's input rows k + u.
struct FilterTile {
  const float* const* rows;  ///< of each channel the tile's input rows
  std::int64_t channels;
  std::int64_t width;  ///< of input rows; zeros surround them
  std::int64_t left, dilation_x;
  std::int64_t filters, kheight, kwidth;
  const float* weight;    ///< channels × kwidth × filters × kheight
  float* sums;            ///< filters × rows of whole vectors
  std::int64_t sum_step;  ///< from row to row
  std::int64_t count;     ///< of output positions in a row
  FilterAhead ahead;      ///< fetched meanwhile, if there is more than one tap row
};

/// The inner loops of the convolutions, compiled once per instruction-set level.
struct Conv2dRoutines {
  Isa isa;
  /// Else a level that differs from the ones below it in the products of words alone, of the precisions in
  /// own_words.
  bool whole;
  bool own_words[3];
  bool splits_pairs;          ///< of 8-bit integers: the words of a are of limited sums (direct/direct.h)
  std::uint32_t byte_offset;  ///< what 8-bit integers of b are stored less: 0, or 128 where they are signed
  bool rounds_to_odd;         ///< sums of products of bfloat16: by less than a unit in the last place
  bool fused;                 ///< multiply and add round once
  std::int64_t rows;          ///< of a panel of the left matrix
  std::int64_t columns;       ///< of a panel of the right matrix
  /// Words of a row of the left matrix that lie together: word k of row m is a[(k / d · rows + m) · d + k %
  /// d]. If there are several, depths are filled up to a multiple of d with zeros in both matrices, and words
  /// of b are gathered.
  std::int64_t tile_depth;

  /// c[m, j] += sum over k < depth of a[k·rows + m] · b[k·columns + j], for all m < row_count <= rows and j <
  /// column_count <= columns and perhaps others within the panel; the sum is taken in the order of k and then
  /// added. c has rows of `columns`, of which the panel's `rows` exist.
  void (*multiply)(const float* a, const float* b, std::int64_t depth, float* c, std::int64_t row_count,
                   std::int64_t column_count);

  /// Rows first_k <= k < last_k of the matrix above, positions first <= p < first + count <= first + columns,
  /// as rows of `columns` floats with zeros at the end.
  void (*pack_columns)(const ColumnSource& source, std::int64_t first, std::int64_t count,
                       std::int64_t first_k, std::int64_t last_k, float* b);

  // By Precision, words as direct/direct.h has them.

  /// Products are added to the sums in the order of k, after what they start from; sums of integers are
  /// int32. With tiles (tiles.h) those of 2·tile_depth products are added.
  void (*multiply_words[3])(const WordProduct& product);
  /// What a thread does before its products of words, and behind them.
  void (*begin_products)();
  void (*end_products)();

  /// In each row y[j] = the word of x[start + j·stride] where that is in [0, width), else `outside`, for j <
  /// count.
  void (*fill_rows[3])(const WordSource& x, const WordRows& rows, float* y);

  /// Rows k < depth, b[k·columns + ...], of the words of a panel. Of x only what the runs name is read; of b
  /// whole vectors are written, up to kRowAlignment - 1 words behind the panel.
  void (*gather[3])(const WordGather& gather, std::int64_t depth, float* b);
  /// The same of words that are ready at source.x: they are copied, and read in whole vectors, too.
  void (*gather_copies)(const WordGather& gather, std::int64_t depth, float* b);

  /// The least and the largest of x[0...count), and 0.
  bool (*range)(const float* x, std::int64_t count, float* low, float* high);

  /// y[j] = elu(a[j]) · sigmoid(g[j]) for j < count. a and g are read up to a multiple of the vector width.
  void (*gate)(const float* a, const float* g, float* y, std::int64_t count);

  /// y[p] = bias + the taps' products in their order, for p < count. x is read up to a multiple of the vector
  /// width.
  void (*depthwise_row)(const DepthwiseRow& row, float* y, std::int64_t count);

  /// y[p] = bias + the sum over the columns in their order, each the sum of its taps in theirs. x is read
  /// around the planes, at most as many rows as taps and steps reach and a vector.
  void (*depthwise_plane)(const DepthwisePlane& plane, float* y);

  /// Rows of even length become planes split by a stride of 2: even rows' even columns, their odd columns,
  /// odd rows' even and odd columns, phase_size apart. Numbers below `least` count as that.
  void (*split_plane)(const float* x, std::int64_t rows, std::int64_t width, float least, float* y,
                      std::int64_t phase_size);

  /// Output rows of a FilterTile, by filters - 1, if it has more than one tap row; else it has one.
  std::int64_t filter_rows[4];
  /// Adds the sum of the products to the sums: in the order of channels, tap columns, tap rows. Tap rows: 3,
  /// 5 or 7, or 1 and one tap column; 1 to 4 filters.
  void (*add_filters)(const FilterTile& tile);
};

/// A multiple of all levels' vector widths: rows that routines may read beyond their end are padded to it.
inline constexpr std::int64_t kRowAlignment = 16;

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const Conv2dRoutines* const> conv2d_routines();

}  // namespace slide::ops
