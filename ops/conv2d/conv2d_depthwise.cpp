#include "ops/conv2d/conv2d_depthwise.h"

#include <algorithm>
#include <atomic>
#include <cstring>
#include <limits>

#include "runtime/threads.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kWideRow = 64;  // long enough to be summed by itself
constexpr std::int64_t kChunk = 2048;  // sums in flight: they stay in the first-level cache

std::int64_t aligned(std::int64_t count) {
  return (count + kRowAlignment - 1) / kRowAlignment * kRowAlignment;
}

}  // namespace

Conv2dDepthwise::Conv2dDepthwise(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                                 const Conv2dFusion& fusion)
    : routines_(routines),
      g_(geometry),
      relu_input_(fusion.relu_input),
      epilogue_(fusion, routines.isa, true),
      plane_width_(g_.owidth + (g_.kwidth - 1) * g_.dilation_x / g_.stride_x),
      plane_rows_(g_.oheight + (g_.kheight - 1) * g_.dilation_y / g_.stride_y),
      chunk_rows_(std::clamp<std::int64_t>(kChunk / plane_width_, 1, g_.oheight)) {
  for (std::int64_t u = 0; u < g_.kheight; ++u)
    for (std::int64_t v = 0; v < g_.kwidth; ++v) {
      const std::int64_t y = u * g_.dilation_y;
      const std::int64_t x = v * g_.dilation_x;
      const std::int64_t phase = y % g_.stride_y * g_.stride_x + x % g_.stride_x;
      offsets_.push_back(static_cast<std::int32_t>((phase * plane_rows_ + y / g_.stride_y) * plane_width_ +
                                                   x / g_.stride_x));
    }
}

/// All phases, and what whole vectors read behind them.
std::int64_t Conv2dDepthwise::padded_size() const noexcept {
  return aligned(g_.stride_y * g_.stride_x * plane_rows_ * plane_width_ + kRowAlignment);
}

std::int64_t Conv2dDepthwise::thread_size() const noexcept {
  return padded_size() + aligned(chunk_rows_ * plane_width_);
}

std::size_t Conv2dDepthwise::scratch_bytes() const noexcept {
  return static_cast<std::size_t>(std::min<std::int64_t>(thread_count(), g_.batch * g_.ic) * thread_size()) *
         sizeof(float);
}

double Conv2dDepthwise::error_factor() const noexcept {
  return 1.001 * static_cast<double>(g_.depth() + (routines_.fused ? 0 : 1));
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

void Conv2dDepthwise::pad_plane(const float* x, float* padded) const {
  const auto fill = routines_.fill_rows[static_cast<std::size_t>(Precision::kFp32)];
  const float least = relu_input_ ? 0.0F : -std::numeric_limits<float>::infinity();
  for (std::int64_t phase = 0; phase < g_.stride_y * g_.stride_x; ++phase) {
    const std::int64_t start = phase / g_.stride_x - g_.top;
    const TapRange inside = tap_range(start, g_.stride_y, g_.height, plane_rows_);
    float* y = padded + phase * plane_rows_ * plane_width_;
    std::fill_n(y, inside.first * plane_width_, 0.0F);
    std::fill(y + inside.last * plane_width_, y + plane_rows_ * plane_width_, 0.0F);
    fill({x + (start + inside.first * g_.stride_y) * g_.width, 0, 1, 0, 1, least},
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

void Conv2dDepthwise::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
  auto* memory = static_cast<float*>(static_cast<void*>(scratch.data()));
  const std::int64_t slots = static_cast<std::int64_t>(scratch.size() / sizeof(float)) / thread_size();
  std::atomic<std::int64_t> next{0};
  parallel_for(slots, [&](std::int64_t slot) {
    float* padded = memory + slot * thread_size();
    float* sums = padded + padded_size();
    std::fill(sums - kRowAlignment - kRowAlignment, sums, 0.0F);  // read, and dropped
    for (std::int64_t plane = next++; plane < g_.batch * g_.ic; plane = next++) {
      pad_plane(arrays.x + plane * g_.plane(), padded);
      const std::int64_t group = plane % g_.ic;
      for (std::int64_t o = group * g_.group_oc; o < (group + 1) * g_.group_oc; ++o)
        run_filter(plane, o, padded, arrays, sums);
    }
  });
}

}  // namespace slide::ops
