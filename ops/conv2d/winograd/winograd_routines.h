#pragma once

#include <cstdint>

#include "runtime/cpu.h"

namespace slide::ops {

inline constexpr std::int64_t kCacheLine = 16;  ///< floats

/// The pairs of points ±p of a tile of m = 2·pairs, as the transforms use them.
struct WinogradPoints {
  float square[3];    ///< p²
  float power[3][6];  ///< p^i
};

/// One line of tiles of the channels of a word (one, of bfloat16 two), see Conv2dWinograd.
struct WinogradInput {
  const float* const* rows;  ///< of each channel m + 2 rows of the input, zeros where outside
  /// Blended: of each channel the m + 2 rows that are a quarter of the sum with `rows`. Rows begin one column
  /// before that of the first two, but at the image's left edge, and end one after that of the last two, but
  /// at its right edge.
  const float* const* far_rows;
  /// From rows to those of a channel to come, of which all but the first two are fetched meanwhile; 0: none.
  std::int64_t ahead;
  std::int64_t left;   ///< columns of zeros first
  std::int64_t count;  ///< then input columns
  std::int64_t used;   ///< then zeros, up to here
  bool relu;           ///< x is max(x, 0)
  bool doubled;        ///< rows hold each two columns once; the first is the second of two if `odd`, not else
  bool blended;        ///< the same, but the two are blends of a row's column and its neighbours'
  bool odd, left_edge, right_edge;
  std::int64_t dilation;  ///< horizontal
  std::int64_t tiles;     ///< of the line
  float* buffer;  ///< of each m + 2 rows of row_size, of which a vector's tiles beyond the last are read
  std::int64_t row_size;
  float* phases;  ///< memory for (m + 2)·m rows of phase_size of each
  std::int64_t phase_size;
  float* v;                   ///< these channels' row of words of the first panel and frequency
  std::int64_t first;         ///< the line's first tile is column first % columns of panel first / columns
  std::int64_t columns;       ///< of a panel
  std::int64_t panel_stride;  ///< from panel to panel
  std::int64_t frequency_stride;  ///< from frequency to frequency
};

/// Adjacent tiles of one output channel.
struct WinogradOutput {
  const float* m;  ///< the first tile's product; read up to a multiple of the vector width
  std::int64_t frequency_stride;
  std::int64_t tiles;
  float bias;
  std::int64_t rows;  ///< of the tiles, that are wanted
  float* y;           ///< row i of the tiles starts at i·row_size
  std::int64_t row_size;
  bool interleave;  ///< rows of adjacent columns, which are finished as below
  std::int64_t columns;
  bool non_temporal;      ///< their stores bypass the caches
  const float* residual;  ///< as y, or null
  bool residual_last;     ///< added after the clamp
  float low, high;        ///< the clamp
};

/// The transforms of one tile size.
struct WinogradTransforms {
  /// V = Bᵀ d B of a line's tiles, as words of one float32 or of two bfloat16, by Precision. Up to a vector
  /// of the panels' columns after the line's last tile is overwritten, within the panel.
  void (*input[2])(const WinogradPoints& points, const WinogradInput& line);
  /// Aᵀ M A + bias. Interleaved, y[i][m·t + j] is row i and column j of tile t, for m·t + j < columns; else
  /// y[i][j][t] with rows j of row_size / m, written up to a multiple of the vector width of tiles.
  void (*output)(const WinogradPoints& points, const WinogradOutput& run);
};

/// c[m, j] = sum over k < depth of a[m / rows][k][m % rows] · b[k][j], for all m < row_count and j <
/// column_count <= columns and perhaps others within their panels; plus what c was, if `add`. Of words of
/// float32, blocks of `block` products are summed in order, then c and the blocks in order; of words of
/// bfloat16 c and all products in order. Another panel of a may be fetched into the first-level cache.
struct WinogradProduct {
  const float* a;             ///< adjacent panels of words
  const float* b;             ///< one panel
  std::int64_t depth, block;  ///< words
  bool add;
  float* c;  ///< rows of `columns`, c_stride apart
  std::int64_t c_stride;
  std::int64_t row_count, column_count;
  const float* next_b;  ///< for each panel of a, depth cache lines that are wanted in the second-level cache
  /// The same: ahead_lines of them, from panel to panel ahead_stride apart.
  const float* ahead;
  std::int64_t ahead_lines, ahead_stride;
};

/// The same sums, in the same order, for one panel of `filters` rows and all columns: c[m, j] is the sum over
/// k < depth of a[k][m] · b[j / columns][k][j % columns], for all m < row_count and j < tiles rounded up to a
/// multiple of the vector width. Sums of a depth in parts of whole blocks are as those of it at once.
struct WinogradFilterProduct {
  const float* a;      ///< one panel of words
  const float* ahead;  ///< for each word ahead_step numbers are fetched into the second-level cache
  std::int64_t ahead_step;
  const float* b;  ///< panels of an even number of columns
  std::int64_t columns, panel_stride;
  std::int64_t depth, block;  ///< words
  std::int64_t tiles;
  bool add;     ///< to what the sums were
  bool last;    ///< the sums are written to c
  float* sums;  ///< memory for [j][m], for j < tiles rounded up to kRowAlignment
  float* c;     ///< rows c_stride apart
  std::int64_t c_stride;
  std::int64_t row_count;
};

/// The products of one kind of words.
struct WinogradMultiplier {
  std::int64_t rows;     ///< of a panel of the left matrix; even
  std::int64_t columns;  ///< of a panel of the right matrix; even
  void (*multiply)(const WinogradProduct& product);
  std::int64_t filters;     ///< of a panel of the left matrix with filters as lanes
  std::int64_t tiles;       ///< that are then multiplied together; even
  std::int64_t most_tiles;  ///< for which that is faster
  void (*multiply_filters)(const WinogradFilterProduct& product);
};

/// The inner loops of the Winograd convolutions, compiled once per instruction-set level.
struct WinogradRoutines {
  Isa isa;
  bool fused;  ///< multiply and add round once

  const WinogradMultiplier* multipliers;  ///< by Precision: float32, bfloat16

  WinogradTransforms two, four, six;  ///< tiles of m = 2, 4, 6
};

/// Those of a level of this build.
[[nodiscard]] const WinogradRoutines& winograd_routines(Isa isa);

}  // namespace slide::ops
