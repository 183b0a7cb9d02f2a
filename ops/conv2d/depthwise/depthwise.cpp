#include "ops/conv2d/depthwise/depthwise.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "runtime/threads.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kWideRow = 64;  // long enough to be summed by itself
constexpr std::int64_t kMostTaps = 5;  // of DepthwiseRun
constexpr std::int64_t kChunk = 2048;  // sums in flight: they stay in the first-level cache

std::int64_t aligned(std::int64_t count) {
  return (count + kRowAlignment - 1) / kRowAlignment * kRowAlignment;
}

/// offset = stride · index + phase, 0 <= phase < stride.
struct Split {
  std::int64_t index, phase;
};
Split split(std::int64_t offset, std::int64_t stride) {
  const std::int64_t phase = (offset % stride + stride) % stride;
  return {(offset - phase) / stride, phase};
}

}  // namespace

Conv2dDepthwise::Conv2dDepthwise(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                                 const Conv2dFusion& fusion)
    : routines_(routines),
      g_(geometry),
      epilogue_(fusion, routines.isa, true),
      least_(fusion.relu_input ? 0.0F : -std::numeric_limits<float>::infinity()),
      joined_(can_join_rows()),
      plane_width_(g_.owidth + (g_.kwidth - 1) * g_.dilation_x / g_.stride_x),
      plane_rows_(g_.oheight + (g_.kheight - 1) * g_.dilation_y / g_.stride_y),
      chunk_rows_(std::clamp<std::int64_t>(kChunk / plane_width_, 1, g_.oheight)) {
  if (joined_) {
    list_runs();
    return;
  }
  for (std::int64_t u = 0; u < g_.kheight; ++u)
    for (std::int64_t v = 0; v < g_.kwidth; ++v) {
      const std::int64_t y = u * g_.dilation_y;
      const std::int64_t x = v * g_.dilation_x;
      const std::int64_t phase = y % g_.stride_y * g_.stride_x + x % g_.stride_x;
      offsets_.push_back(static_cast<std::int32_t>((phase * plane_rows_ + y / g_.stride_y) * plane_width_ +
                                                   x / g_.stride_x));
    }
}

bool Conv2dDepthwise::can_join_rows() const noexcept {
  const std::int64_t stride = g_.stride_y;
  return g_.stride_x == stride && stride <= 2 && g_.dilation_y == 1 && g_.dilation_x == 1 &&
         g_.kheight <= kMostTaps && g_.height == stride * g_.oheight && g_.width == stride * g_.owidth;
}

/// For each column of the filter its rows, those of each phase together.
void Conv2dDepthwise::list_runs() {
  const std::int64_t stride = g_.stride_y;
  const std::int64_t width = g_.owidth;
  const auto work = [&](std::int64_t rows) { return (g_.oheight + rows - 1) / rows * aligned(rows * width); };
  for (const std::int64_t rows : {2, 4})
    if (work(rows) < work(step_rows_)) step_rows_ = rows;
  margin_ = aligned((g_.kheight + step_rows_) * width + g_.kwidth) + kRowAlignment;
  phase_size_ = margin_ + aligned(g_.oplane());
  const std::int64_t mask_size = aligned(step_rows_ * width);
  masks_.assign(static_cast<std::size_t>(g_.kwidth * mask_size), 0.0F);
  for (std::int64_t v = 0; v < g_.kwidth; ++v) {
    const Split column = split(v - g_.left, stride);
    float* mask = masks_.data() + v * mask_size;
    for (std::int64_t j = 0; j < mask_size; ++j)
      if (const std::int64_t at = j % width + column.index; at >= 0 && at < width)
        mask[j] = std::bit_cast<float>(~std::uint32_t{0});
    for (std::int64_t first = 0; first < std::min(stride, g_.kheight); ++first) {
      const Split row = split(first - g_.top, stride);
      const std::int64_t phase = row.phase * stride + column.phase;
      runs_.push_back({static_cast<std::int32_t>(phase * phase_size_ + row.index * width + column.index),
                       static_cast<std::int32_t>(first * g_.kwidth + v),
                       static_cast<std::int32_t>((g_.kheight - first + stride - 1) / stride), nullptr});
    }
    runs_.back().mask = mask;
  }
}

/// All phases, and what whole vectors read around them.
std::int64_t Conv2dDepthwise::padded_size() const noexcept {
  if (joined_) return g_.stride_y * g_.stride_x * phase_size_ + margin_;
  return aligned(g_.stride_y * g_.stride_x * plane_rows_ * plane_width_ + kRowAlignment);
}

std::int64_t Conv2dDepthwise::thread_size() const noexcept {
  return padded_size() + (joined_ ? 0 : aligned(chunk_rows_ * plane_width_));
}

std::size_t Conv2dDepthwise::scratch_bytes() const noexcept {
  return static_cast<std::size_t>(std::min<std::int64_t>(thread_count(), g_.batch * g_.ic) * thread_size()) *
         sizeof(float);
}

double Conv2dDepthwise::error_factor() const noexcept {
  const std::int64_t roundings = joined_ ? g_.kheight + g_.kwidth : g_.depth();
  return 1.001 * static_cast<double>(roundings + (routines_.fused ? 0 : 1));
}

std::size_t Conv2dDepthwise::packed_bytes() const noexcept {
  return static_cast<std::size_t>(g_.oc * g_.depth()) * sizeof(float);
}

void Conv2dDepthwise::pack(const float* weight, std::byte* packed) const {
  std::memcpy(packed, weight, packed_bytes());
}

double Conv2dDepthwise::macs() const noexcept {
  return static_cast<double>(g_.batch * g_.oc * g_.oplane()) * static_cast<double>(g_.depth());
}

/// Between margins that are zero.
void Conv2dDepthwise::copy_plane(const float* x, float* planes) const {
  if (g_.stride_y == 2) return routines_.split_plane(x, g_.height, g_.width, least_, planes, phase_size_);
  const auto fill = routines_.fill_rows[static_cast<std::size_t>(Precision::kFp32)];
  fill({x, 0, 1, 0, 1, least_}, {1, 0, 0, g_.plane(), 0, 1, g_.plane(), 0.0F}, planes);
}

void Conv2dDepthwise::run_joined(std::int64_t plane, std::int64_t filter, const float* planes,
                                 const Conv2dArrays& arrays) const {
  const auto* weight =
      static_cast<const float*>(static_cast<const void*>(arrays.packed)) + filter * g_.depth();
  float* y = arrays.y + (plane / g_.ic * g_.oc + filter) * g_.oplane();
  const float* residual = arrays.residual != nullptr ? arrays.residual + (y - arrays.y) : nullptr;
  routines_.depthwise_plane(
      {planes, g_.owidth, g_.oplane(), step_rows_, runs_.data(), std::ssize(runs_), weight,
       g_.stride_y * g_.kwidth, arrays.bias != nullptr ? arrays.bias[filter] : 0.0F, epilogue_.low(),
       epilogue_.high()},
      y);
  if (!epilogue_.empty(residual)) epilogue_.finish(y, residual, y, g_.oplane());
}

void Conv2dDepthwise::pad_plane(const float* x, float* padded) const {
  const auto fill = routines_.fill_rows[static_cast<std::size_t>(Precision::kFp32)];
  for (std::int64_t phase = 0; phase < g_.stride_y * g_.stride_x; ++phase) {
    const std::int64_t start = phase / g_.stride_x - g_.top;
    const TapRange inside = tap_range(start, g_.stride_y, g_.height, plane_rows_);
    float* y = padded + phase * plane_rows_ * plane_width_;
    std::fill_n(y, inside.first * plane_width_, 0.0F);
    std::fill(y + inside.last * plane_width_, y + plane_rows_ * plane_width_, 0.0F);
    fill({x + (start + inside.first * g_.stride_y) * g_.width, 0, 1, 0, 1, least_},
         {inside.last - inside.first, g_.stride_y * g_.width, plane_width_, g_.width,
          phase % g_.stride_x - g_.left, g_.stride_x, plane_width_, 0.0F},
         y + inside.first * plane_width_);
  }
}

void Conv2dDepthwise::run_filter(std::int64_t plane, std::int64_t filter, const float* padded,
                                 const Conv2dArrays& arrays, float* sums) const {
  const auto* weight =
      static_cast<const float*>(static_cast<const void*>(arrays.packed)) + filter * g_.depth();
  const float bias = arrays.bias != nullptr ? arrays.bias[filter] : 0.0F;
  const std::int64_t at = (plane / g_.ic * g_.oc + filter) * g_.oplane();
  DepthwiseRow row{padded, offsets_.data(), weight, g_.depth(), bias, epilogue_.low(), epilogue_.high()};
  if (g_.owidth >= kWideRow && epilogue_.empty(arrays.residual)) {  // nothing comes after the sums
    for (std::int64_t i = 0; i < g_.oheight; ++i, row.x += plane_width_)
      routines_.depthwise_row(row, arrays.y + at + i * g_.owidth, g_.owidth);
    return;
  }
  for (std::int64_t first = 0; first < g_.oheight; first += chunk_rows_) {
    const std::int64_t rows = std::min(chunk_rows_, g_.oheight - first);
    row.x = padded + first * plane_width_;
    routines_.depthwise_row(row, sums, (rows - 1) * plane_width_ + g_.owidth);
    for (std::int64_t i = 0; i < rows; ++i) {
      const std::int64_t to = at + (first + i) * g_.owidth;
      epilogue_.finish(sums + i * plane_width_, arrays.residual != nullptr ? arrays.residual + to : nullptr,
                       arrays.y + to, g_.owidth);
    }
  }
}

/// A weight that is NaN or infinite makes NaN where it meets padding, whose zeros are not multiplied.
void Conv2dDepthwise::spoil_padded(const float* weight, float* y) const {
  for (std::int64_t k = 0; k < g_.depth(); ++k) {
    if (std::isfinite(weight[k])) continue;
    const TapRange rows =
        tap_range(k / g_.kwidth * g_.dilation_y - g_.top, g_.stride_y, g_.height, g_.oheight);
    const TapRange columns =
        tap_range(k % g_.kwidth * g_.dilation_x - g_.left, g_.stride_x, g_.width, g_.owidth);
    for (std::int64_t i = 0; i < g_.oheight; ++i)
      for (std::int64_t j = 0; j < g_.owidth; ++j)
        if (i < rows.first || i >= rows.last || j < columns.first || j >= columns.last)
          y[i * g_.owidth + j] = std::numeric_limits<float>::quiet_NaN();
  }
}

void Conv2dDepthwise::run_plane(std::int64_t plane, float* padded, const Conv2dArrays& arrays,
                                float* sums) const {
  const float* x = arrays.x + plane * g_.plane();
  if (joined_)
    copy_plane(x, padded + margin_);
  else
    pad_plane(x, padded);
  const std::int64_t group = plane % g_.ic;
  for (std::int64_t o = group * g_.group_oc; o < (group + 1) * g_.group_oc; ++o) {
    if (joined_)
      run_joined(plane, o, padded + margin_, arrays);
    else
      run_filter(plane, o, padded, arrays, sums);
    spoil_padded(static_cast<const float*>(static_cast<const void*>(arrays.packed)) + o * g_.depth(),
                 arrays.y + (plane / g_.ic * g_.oc + o) * g_.oplane());
  }
}

void Conv2dDepthwise::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
  auto* memory = static_cast<float*>(static_cast<void*>(scratch.data()));
  const std::int64_t slots = static_cast<std::int64_t>(scratch.size() / sizeof(float)) / thread_size();
  WorkRanges planes(g_.batch * g_.ic, slots);
  parallel_for(slots, [&](std::int64_t slot) {
    float* padded = memory + slot * thread_size();
    float* sums = padded + padded_size();
    // Read, and dropped; or zeros around planes.
    std::fill(joined_ ? padded : sums - kRowAlignment - kRowAlignment, sums, 0.0F);
    for (auto range = planes.take(slot); range.first < range.last; range = planes.take(slot))
      for (std::int64_t plane = range.first; plane < range.last; ++plane)
        run_plane(plane, padded, arrays, sums);
  });
}

}  // namespace slide::ops
