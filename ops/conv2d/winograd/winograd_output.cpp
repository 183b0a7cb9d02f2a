// The end of a Winograd convolution: products become rows of the result. Where those are adjacent columns
// that only a residual and a clamp finish, the output transform writes them; else they pass through memory.

#include <algorithm>

#include "ops/conv2d/winograd/winograd.h"
#include "ops/conv2d/winograd/winograd_tiles.h"

namespace slide::ops {
namespace {

/// What the next filter's rows will be written to, unless that bypasses the caches, and added.
void prefetch_rows(const WinogradOutput& out, std::int64_t plane) {
  for (std::int64_t i = 0; i < out.rows; ++i)
    for (std::int64_t j = 0; j < out.columns; j += kCacheLine) {
      const std::int64_t at = plane + i * out.row_size + j;
      if (!out.non_temporal) __builtin_prefetch(out.y + at, 1);
      if (out.residual != nullptr) __builtin_prefetch(out.residual + at);
    }
}

}  // namespace

/// A gated filter's feature comes before its gate; both are written together.
void Conv2dWinogradBase::transform_filters(const Run& run, const float* products, const Conv2dArrays& arrays,
                                           float* sums) const {
  WinogradOutput out{};
  out.frequency_stride = product_stride_;
  out.tiles = run.last - run.first;
  out.interleave = g_.dilation_x == 1;
  out.rows = std::min<std::int64_t>(tile_, (g_.oheight - run.row - 1) / g_.dilation_y + 1);
  out.row_size = tile_ * phase_size_;
  out.columns = out.row_size;
  out.low = epilogue_.low();
  out.high = epilogue_.high();
  out.residual_last = residual_last_;
  out.non_temporal = non_temporal_;
  const std::int64_t gate = tile_ * out.row_size;  // from the feature's sums to the gate's
  if (finishes_rows_) {
    out.row_size = g_.dilation_y * g_.owidth;
    out.columns = std::min(out.tiles * tile_, g_.owidth - run.first * tile_);
  }
  for (std::int64_t row = run.first_filter; row < run.last_filter; ++row) {
    out.m = products + (row - run.first_filter) * product_row_;
    out.bias = arrays.bias != nullptr ? arrays.bias[filter_of_row(g_, gated_, 0, row)] : 0.0F;
    out.y = gated_ && row % 2 == 1 ? sums + gate : sums;
    if (finishes_rows_) {
      const std::int64_t at =
          (run.image * g_.oc + row) * g_.oplane() + run.row * g_.owidth + run.first * tile_;
      out.y = arrays.y + at;
      out.residual = arrays.residual != nullptr ? arrays.residual + at : nullptr;
      if (row + 1 < run.last_filter) prefetch_rows(out, g_.oplane());
    }
    transforms_.output(points_, out);
    if (!finishes_rows_ && (!gated_ || row % 2 == 1)) write_filter(run, row, sums, arrays);
  }
}

/// Dilated, adjacent columns come from tiles that have all phases; others are written phase by phase.
void Conv2dWinogradBase::write_filter(const Run& run, std::int64_t row, float* sums,
                                      const Conv2dArrays& arrays) const {
  const std::int64_t row_size = tile_ * phase_size_;
  const std::int64_t gate = tile_ * row_size;  // from the feature's sums to the gate's
  const std::int64_t channels = gated_ ? g_.oc / 2 : g_.oc;
  const std::int64_t plane = (run.image * channels + (gated_ ? row / 2 : row)) * g_.oplane();
  const std::int64_t d = g_.dilation_x;
  float* columns = sums + 2 * gate;
  for (std::int64_t i = 0; i < tile_ && run.row + i * g_.dilation_y < g_.oheight; ++i) {
    float* from = sums + i * row_size;
    const auto finish = [&](float* values, std::int64_t gate_distance, std::int64_t column,
                            std::int64_t count) {
      count = std::min(count, g_.owidth - column);
      if (count <= 0) return;
      const std::int64_t at = plane + (run.row + i * g_.dilation_y) * g_.owidth + column;
      const float* residual = arrays.residual != nullptr ? arrays.residual + at : nullptr;
      if (gated_ && epilogue_.empty(residual))
        return routines_.gate(values, values + gate_distance, arrays.y + at, count);
      if (gated_) routines_.gate(values, values + gate_distance, values, count);
      epilogue_.finish(values, residual, arrays.y + at, count);
    };
    if (d == 1) {
      finish(from, gate, run.first * tile_, (run.last - run.first) * tile_);
      continue;
    }
    for (std::int64_t t = run.first; t < run.last;) {
      const std::int64_t whole = t % d == 0 ? (run.last - t) / d * d : 0;
      if (whole > 0) {
        for (std::int64_t part = 0; part < (gated_ ? 2 : 1); ++part)
          join_phases(from + part * gate + t - run.first, whole, columns + part * row_size);
        finish(columns, row_size, tile_start(t, tile_, d), whole * tile_);
        t += whole;
        continue;
      }
      const std::int64_t count = std::min(d - t % d, run.last - t);
      for (std::int64_t j = 0; j < tile_; ++j)
        finish(from + j * phase_size_ + t - run.first, gate, tile_start(t, tile_, d) + j * d, count);
      t += count;
    }
  }
}

/// Adjacent columns of `count` tiles, a multiple of the dilation.
void Conv2dWinogradBase::join_phases(const float* phases, std::int64_t count, float* columns) const {
  const std::int64_t d = g_.dilation_x;
  for (std::int64_t t = 0; t < count; t += d)
    for (std::int64_t j = 0; j < tile_; ++j, columns += d)
      for (std::int64_t k = 0; k < d; ++k) columns[k] = phases[j * phase_size_ + t + k];
}

}  // namespace slide::ops
