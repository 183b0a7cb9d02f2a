// The weights of direct convolutions, packed once.

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "ops/conv2d/bf16_bits.h"
#include "ops/conv2d/conv2d_op.h"
#include "ops/conv2d/direct/direct.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

/// Taps 2×2 of one parity stand for these rows (or columns) of the 3×3.
bool stands_for(std::int64_t parity, std::int64_t tap, std::int64_t u) {
  return parity == 0 ? (tap == 0) == (u == 0) : (tap == 1) == (u == 2);
}

}  // namespace

/// Packed: for each variant and group the blocks of the depth, in each the panels
/// (Conv2dRoutines::tile_depth), so that a task reads them in their order; for integers then the step and the
/// sum of each row.
std::size_t Conv2dDirect::packed_bytes() const noexcept {
  const std::int64_t rows = variants_ * g_.groups * panels_ * routines_.rows;
  return static_cast<std::size_t>(rows * (filled(depth_) + (precision_ == Precision::kInt8 ? 2 : 0))) *
         sizeof(float);
}

double Conv2dDirect::weight_at(const float* weight, std::int64_t filter, std::int64_t channel, int variant,
                               std::int64_t tap) const noexcept {
  const float* kernel = weight + (filter * g_.group_ic + channel) * g_.kheight * g_.kwidth;
  if (!upsampled_) return static_cast<double>(kernel[tap]);
  double sum = 0;
  for (std::int64_t u = 0; u < 3; ++u)
    for (std::int64_t v = 0; v < 3; ++v)
      if (stands_for(variant / 2, tap / 2, u) && stands_for(variant % 2, tap % 2, v))
        sum += static_cast<double>(kernel[u * 3 + v]);
  return sum;
}

float Conv2dDirect::pack_word(const float* weight, std::int64_t filter, std::int64_t k, int variant,
                              float step) const {
  const std::int64_t channel = k / taps_ * lanes_;
  if (precision_ == Precision::kFp32)
    return static_cast<float>(weight_at(weight, filter, channel, variant, k % taps_));
  std::uint32_t word = 0;
  const int bits = precision_ == Precision::kBf16 ? 16 : 8;
  for (std::int64_t lane = 0; lane < std::min(lanes_, g_.group_ic - channel); ++lane) {
    const double w = std::isnan(step) ? 0 : weight_at(weight, filter, channel + lane, variant, k % taps_);
    const std::uint32_t part = bits == 16 ? bf16_bits(static_cast<float>(w))
                                          : static_cast<std::uint8_t>(std::lround(
                                                std::clamp(w / static_cast<double>(step), -127.0, 127.0)));
    word |= part << static_cast<unsigned>(lane * bits);
  }
  return std::bit_cast<float>(word);
}

/// `panel` counts those of all variants and groups.
void Conv2dDirect::pack_panel(const float* weight, std::int64_t panel, float* panels, float* steps,
                              float* sums) const {
  const std::int64_t rows = routines_.rows;
  const int variant = static_cast<int>(panel / (g_.groups * panels_));
  const std::int64_t group = panel / panels_;
  panel %= panels_;
  for (std::int64_t m = 0; m < rows; ++m) {
    const std::int64_t row = panel * rows + m;
    const bool inside = row < g_.group_oc;
    const std::int64_t filter = inside ? filter_of_row(g_, gated_, group % g_.groups, row) : 0;
    float step = 1;
    if (precision_ == Precision::kInt8) {
      double largest = 0;
      for (std::int64_t k = 0; inside && k < g_.group_ic * taps_; ++k) {
        const double size = std::fabs(weight_at(weight, filter, k / taps_, variant, k % taps_));
        if (size > largest || !std::isfinite(size)) largest = size;
        if (!std::isfinite(size)) break;
      }
      if (largest != 0) step = static_cast<float>(largest / 127);
      if (!std::isfinite(step))
        step = std::numeric_limits<float>::quiet_NaN();  // so is what the filter gives
      steps[m] = step;
    }
    const bool as_it_is = precision_ == Precision::kFp32 && !upsampled_;  // most of what is ever packed
    std::int32_t sum = 0;
    for (std::int64_t block = 0; block < depth_; block += block_depth_) {
      const std::int64_t depth = std::min(block_depth_, depth_ - block), whole = filled(depth);
      const std::int64_t tile = routines_.tile_depth;
      float* to =
          panels + (group * panels_ * filled(depth_) + panels_ * block + panel * whole) * rows + m * tile;
      const float* from = weight + filter * depth_ + block;
      for (std::int64_t k = 0; as_it_is && k < depth; ++k) to[k * rows] = inside ? from[k] : 0.0F;
      for (std::int64_t k = 0; !as_it_is && k < whole; ++k) {
        const bool exists = inside && k < depth;
        const float word = exists ? pack_word(weight, filter, block + k, variant, step) : 0.0F;
        std::memcpy(to + k / tile * tile * rows + k % tile, &word, sizeof word);
        for (unsigned lane = 0; lane < 4; ++lane)
          sum += static_cast<std::int8_t>(std::bit_cast<std::uint32_t>(word) >> 8 * lane & 0xFFU);
      }
    }
    if (precision_ == Precision::kInt8) sums[m] = std::bit_cast<float>(sum);
  }
}

void Conv2dDirect::pack(const float* weight, std::byte* packed) const {
  const std::int64_t all = variants_ * g_.groups * panels_;
  auto* panels = static_cast<float*>(static_cast<void*>(packed));
  float* steps = panels + all * routines_.rows * filled(depth_);
  float* sums = steps + all * routines_.rows;
  parallel_for(all, [&](std::int64_t panel) {
    pack_panel(weight, panel, panels, steps + panel * routines_.rows, sums + panel * routines_.rows);
  });
}

}  // namespace slide::ops
