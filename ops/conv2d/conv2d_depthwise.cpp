#include "ops/conv2d/conv2d_depthwise.h"

#include <algorithm>
#include <atomic>
#include <cstring>

#include "runtime/tensor.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

std::int64_t round_up(std::int64_t value, std::int64_t unit) { return (value + unit - 1) / unit * unit; }

}  // namespace

Conv2dDepthwise::Conv2dDepthwise(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                                 const Conv2dFusion& fusion)
    : routines_(routines),
      g_(geometry),
      relu_input_(fusion.relu_input),
      relu_(unary_row(UnaryOp(UnaryKind::kRelu), pointwise_routines_of(routines.isa))),
      epilogue_(fusion, routines.isa) {
  rows_ = (g_.oheight - 1) * g_.stride_y + (g_.kheight - 1) * g_.dilation_y + 1;
  // The last tap starts at (kw - 1)·dilation / stride; from there whole vectors up to the last column are
  // read.
  phase_size_ = round_up((g_.kwidth - 1) * g_.dilation_x / g_.stride_x + round_up(g_.owidth, kRowAlignment),
                         kRowAlignment);
}

std::int64_t Conv2dDepthwise::thread_bytes() const noexcept {
  const std::int64_t plane = rows_ * g_.stride_x * phase_size_ * static_cast<std::int64_t>(sizeof(float));
  const std::int64_t taps = g_.kheight * g_.kwidth * static_cast<std::int64_t>(sizeof(const float*));
  return plane + round_up(taps, Tensor::kAlignment);
}

std::size_t Conv2dDepthwise::scratch_bytes() const noexcept {
  return static_cast<std::size_t>(std::min<std::int64_t>(thread_count(), g_.batch * g_.ic) * thread_bytes());
}

double Conv2dDepthwise::error_factor() const noexcept {
  return 1.001 * static_cast<double>(g_.depth() + (routines_.fused ? 0 : 1));
}

void Conv2dDepthwise::pad_plane(const float* x, float* padded) const {
  for (std::int64_t row = 0; row < rows_; ++row) {
    const std::int64_t i = row - g_.top;
    for (std::int64_t phase = 0; phase < g_.stride_x; ++phase, padded += phase_size_) {
      if (i < 0 || i >= g_.height) {
        std::fill_n(padded, phase_size_, 0.0F);
        continue;
      }
      const TapRange inside = tap_range(phase - g_.left, g_.stride_x, g_.width, phase_size_);
      const float* source = x + i * g_.width + phase - g_.left;
      std::fill(padded, padded + inside.first, 0.0F);
      if (g_.stride_x == 1)
        std::copy(source + inside.first, source + inside.last, padded + inside.first);
      else
        for (std::int64_t j = inside.first; j < inside.last; ++j) padded[j] = source[j * g_.stride_x];
      std::fill(padded + inside.last, padded + phase_size_, 0.0F);
    }
  }
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

void Conv2dDepthwise::run_filter(std::int64_t plane, std::int64_t filter, const float* padded,
                                 const Conv2dArrays& arrays, const float** taps) const {
  const auto* weight =
      static_cast<const float*>(static_cast<const void*>(arrays.packed)) + filter * g_.depth();
  const float bias = arrays.bias != nullptr ? arrays.bias[filter] : 0.0F;
  const std::int64_t at = (plane / g_.ic * g_.oc + filter) * g_.oplane();
  for (std::int64_t i = 0; i < g_.oheight; ++i) {
    for (std::int64_t u = 0; u < g_.kheight; ++u)
      for (std::int64_t v = 0; v < g_.kwidth; ++v) {
        const std::int64_t row = i * g_.stride_y + u * g_.dilation_y;
        const std::int64_t column = v * g_.dilation_x;
        taps[u * g_.kwidth + v] =
            padded + (row * g_.stride_x + column % g_.stride_x) * phase_size_ + column / g_.stride_x;
      }
    float* y = arrays.y + at + i * g_.owidth;
    routines_.depthwise_row({taps, weight, g_.depth(), bias}, y, g_.owidth);
    if (!epilogue_.empty(arrays.residual))
      epilogue_.finish(y, arrays.residual != nullptr ? arrays.residual + at + i * g_.owidth : nullptr, y,
                       g_.owidth);
  }
}

void Conv2dDepthwise::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
  const std::int64_t slots = static_cast<std::int64_t>(scratch.size()) / thread_bytes();
  std::atomic<std::int64_t> next{0};
  parallel_for(slots, [&](std::int64_t slot) {
    std::byte* memory = scratch.data() + slot * thread_bytes();
    const std::int64_t plane_size = rows_ * g_.stride_x * phase_size_;
    auto* padded = static_cast<float*>(static_cast<void*>(memory));
    auto* taps = static_cast<const float**>(static_cast<void*>(padded + plane_size));
    for (std::int64_t plane = next++; plane < g_.batch * g_.ic; plane = next++) {
      pad_plane(arrays.x + plane * g_.plane(), padded);
      if (relu_input_) relu_(padded, padded, static_cast<std::size_t>(plane_size));
      const std::int64_t group = plane % g_.ic;
      for (std::int64_t o = group * g_.group_oc; o < (group + 1) * g_.group_oc; ++o)
        run_filter(plane, o, padded, arrays, taps);
    }
  });
}

}  // namespace slide::ops
