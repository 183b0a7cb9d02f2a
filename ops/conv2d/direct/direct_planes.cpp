// What direct convolutions make of their input at each run: the quantiser, values of rows, padded planes.

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "ops/conv2d/direct/direct.h"
#include "runtime/threads.h"

namespace slide::ops {

/// Integers hold neither NaN nor infinity: an image that has one takes no part in the range, and its results
/// are made NaN at the end.
Conv2dDirect::Quantiser Conv2dDirect::quantiser(const Conv2dArrays& arrays) const {
  if (precision_ != Precision::kInt8) return {};
  const std::int64_t planes = g_.batch * g_.ic;
  std::vector<Range> ranges(static_cast<std::size_t>(planes));
  std::vector<std::uint8_t> finite(ranges.size());
  const std::int64_t size = in_height_ * in_width_;
  parallel_for(planes, [&](std::int64_t p) {
    const auto at = static_cast<std::size_t>(p);
    finite[at] = routines_.range(arrays.x + p * size, size, &ranges[at].low, &ranges[at].high) ? 1 : 0;
  });
  Quantiser q;
  q.spoiled.assign(static_cast<std::size_t>(g_.batch), 0);
  for (std::int64_t p = 0; p < planes; ++p)
    if (finite[static_cast<std::size_t>(p)] == 0) q.spoiled[static_cast<std::size_t>(p / g_.ic)] = 1;
  float low = 0;
  float high = 0;
  if (arrays.range) {
    low = std::min(0.0F, arrays.range->low);
    high = std::max(0.0F, arrays.range->high);
  } else {
    for (std::int64_t p = 0; p < planes; ++p) {
      if (q.spoiled[static_cast<std::size_t>(p / g_.ic)] != 0) continue;
      low = std::min(low, ranges[static_cast<std::size_t>(p)].low);
      high = std::max(high, ranges[static_cast<std::size_t>(p)].high);
    }
  }
  if (relu_input_) low = 0;
  q.step = high / 255 - low / 255;  // apart: their difference may be beyond float32
  if (!(q.step > 0)) q.step = 1;
  q.zero = std::round(-low / q.step);
  return q;
}

/// NaN throughout the images that hold a NaN or an infinity.
void Conv2dDirect::spoil(const Call& call) const {
  const std::int64_t size = (gated_ ? g_.oc / 2 : g_.oc) * g_.oplane();
  for (std::size_t n = 0; n < call.quantiser.spoiled.size(); ++n)
    if (call.quantiser.spoiled[n] != 0)
      std::fill_n(call.arrays.y + static_cast<std::int64_t>(n) * size, size,
                  std::numeric_limits<float>::quiet_NaN());
}

/// What each row's sums start from, integers' step, bias: zeros behind the last filter.
void Conv2dDirect::make_row_values(const Call& call) const {
  const auto* packed = static_cast<const float*>(static_cast<const void*>(call.arrays.packed));
  const std::int64_t count = variants_ * g_.groups * panels_ * routines_.rows;
  const float* steps = packed + count * filled(depth_);
  for (std::int64_t i = 0; i < count; ++i) {
    const std::int64_t row = i % (panels_ * routines_.rows);
    const std::int64_t group = i / (panels_ * routines_.rows) % g_.groups;
    const bool biased = call.arrays.bias != nullptr && row < g_.group_oc;
    const float bias = biased ? call.arrays.bias[filter_of_row(g_, gated_, group, row)] : 0.0F;
    call.starts[i] = call.biases[i] = bias;
    if (precision_ != Precision::kInt8) continue;
    // What the zero point adds to each sum is taken off.
    const auto sum = std::bit_cast<std::int32_t>(steps[count + i]);
    const std::int32_t zero =
        static_cast<std::int32_t>(call.quantiser.zero) - static_cast<std::int32_t>(routines_.byte_offset);
    call.starts[i] = std::bit_cast<float>(-zero * sum);
    call.steps[i] = steps[i] * call.quantiser.step;
  }
}

/// Some rows of the phases of one word of channels: index = (image, group, word).
void Conv2dDirect::fill_plane(const Call& call, std::int64_t index, std::int64_t first_row, std::int64_t rows,
                              float* plane) const {
  const std::int64_t word = index % group_words_;
  const std::int64_t channel = index / group_words_ * g_.group_ic + word * lanes_;
  const Quantiser& q = call.quantiser;
  const auto zero = static_cast<std::uint32_t>(q.zero);
  const float outside = precision_ == Precision::kInt8
                            ? std::bit_cast<float>((zero ^ routines_.byte_offset) * 0x01010101U)
                            : 0.0F;
  const float* x = call.arrays.x + channel * in_height_ * in_width_;
  WordSource source{x, in_height_ * in_width_, g_.group_ic - word * lanes_, q.zero, 1 / q.step, least_};
  const auto fill = routines_.fill_rows[static_cast<std::size_t>(precision_)];
  for (std::int64_t phase = 0; phase < g_.stride_y * g_.stride_x; ++phase) {
    if (phase_is_read_[static_cast<std::size_t>(phase)] == 0) continue;
    const std::int64_t start = first_row * g_.stride_y + phase / g_.stride_x - g_.top;
    const TapRange inside = tap_range(start, g_.stride_y, in_height_, rows);
    WordRows r{0,
               g_.stride_y * in_width_,
               plane_width_,
               0,
               phase % g_.stride_x - g_.left,
               g_.stride_x,
               plane_width_,
               outside};
    float* y = plane + phase * plane_size_;
    r.rows = inside.first;
    fill(source, r, y);
    r.rows = rows - inside.last;
    fill(source, r, y + inside.last * plane_width_);
    r.rows = inside.last - inside.first;
    r.width = in_width_;
    source.x = x + (start + inside.first * g_.stride_y) * in_width_;
    fill(source, r, y + inside.first * plane_width_);
  }
}

}  // namespace slide::ops
