// The weights of direct convolutions, packed once.

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <vector>

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

std::int64_t divide_up(std::int64_t a, std::int64_t b) { return (a + b - 1) / b; }

int lowest_byte(std::uint32_t bits) {
  const int value = static_cast<int>(bits & 0xFFU);
  return value < 128 ? value : value - 256;
}

/// By how much the magnitudes of the two lower bytes, if of one sign, exceed 128: as a byte with their sign.
std::uint32_t excess_of_pair(std::uint32_t pair) {
  const int first = lowest_byte(pair), second = lowest_byte(pair >> 8);
  if ((first < 0) != (second < 0)) return 0;
  const int excess = std::max(0, std::abs(first + second) - 128);
  return static_cast<std::uint8_t>(first < 0 ? -excess : excess);
}

/// Byte by byte a - b of the first and the third: those that excess_of_pair() takes off.
std::uint32_t without(std::uint32_t a, std::uint32_t b) {
  const std::uint32_t first = (a - b) & 0xFFU, third = ((a >> 16) - (b >> 16)) & 0xFFU;
  return (a & 0xFF00FF00U) | first | third << 16;
}

}  // namespace

/// Packed: for each variant and group the blocks of the depth, in each the panels
/// (Conv2dRoutines::tile_depth), so that a task reads them in their order; for integers then the step and the
/// sum of each row, and what is split off the words of each panel and block.
std::size_t Conv2dDirect::packed_bytes() const noexcept {
  const std::int64_t panels = variants_ * g_.groups * panels_;
  const std::int64_t row = filled(depth_) + (precision_ == Precision::kInt8 ? 2 : 0);
  const std::int64_t rests = divide_up(depth_, block_depth_) * rest_size();
  return static_cast<std::size_t>(panels * (routines_.rows * row + rests)) * sizeof(float);
}

/// Those that a panel of a block may have: with one for half of its words they take about as long as the words.
std::int64_t Conv2dDirect::rest_entries() const noexcept {
  return divide_up(routines_.rows * block_depth_, 2);
}

/// WordProduct::rests of a panel.
std::int64_t Conv2dDirect::rest_size() const noexcept {
  const bool split = routines_.splits_pairs && precision_ == Precision::kInt8;
  return split ? routines_.rows + 2 * rest_entries() : 0;
}

/// Where the words are of a panel, counted over all variants and groups, and of the block that begins at k.
std::int64_t Conv2dDirect::words_at(std::int64_t panel, std::int64_t k) const noexcept {
  const std::int64_t first = panel / panels_ * panels_, depth = std::min(block_depth_, depth_ - k);
  return (first * filled(depth_) + panels_ * k + (panel - first) * filled(depth)) * routines_.rows;
}

std::int64_t Conv2dDirect::rests_at(std::int64_t panel, std::int64_t k) const noexcept {
  const std::int64_t blocks = divide_up(depth_, block_depth_);
  const std::int64_t index = (panel / panels_ * blocks + k / block_depth_) * panels_ + panel % panels_;
  return variants_ * g_.groups * panels_ * routines_.rows * (filled(depth_) + 2) + index * rest_size();
}

/// Takes off a panel's words what their pairs exceed.
void Conv2dDirect::split_pairs(float* words, std::int64_t depth, std::int32_t* rests) const {
  const std::int64_t rows = routines_.rows;
  std::vector<std::int32_t> entries;
  std::vector<std::uint32_t> limited(static_cast<std::size_t>(rows * depth));
  for (std::int64_t m = 0; m < rows; ++m) {
    for (std::int64_t k = 0; k < depth; ++k) {
      const auto whole = std::bit_cast<std::uint32_t>(words[k * rows + m]);
      const std::uint32_t rest = excess_of_pair(whole) | excess_of_pair(whole >> 16) << 16;
      limited[static_cast<std::size_t>(k * rows + m)] = without(whole, rest);
      if (rest == 0) continue;
      entries.push_back(static_cast<std::int32_t>(k));
      entries.push_back(std::bit_cast<std::int32_t>(rest));
    }
    rests[m] = static_cast<std::int32_t>(entries.size() / 2);
  }
  if (std::ssize(entries) > 2 * rest_entries()) {
    rests[0] = -1;
    return;
  }
  std::ranges::copy(entries, rests + rows);
  std::memcpy(words, limited.data(), limited.size() * sizeof(float));
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
  const std::int64_t index = panel;
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
      float* to = panels + words_at(index, block) + m * tile;
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
    for (std::int64_t k = 0; rest_size() > 0 && k < depth_; k += block_depth_)
      split_pairs(panels + words_at(panel, k), std::min(block_depth_, depth_ - k),
                  static_cast<std::int32_t*>(static_cast<void*>(panels + rests_at(panel, k))));
  });
}

}  // namespace slide::ops
