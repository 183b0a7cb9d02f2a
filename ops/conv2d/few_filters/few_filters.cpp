#include "ops/conv2d/few_filters/few_filters.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "runtime/threads.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kMostFilters = 4;
constexpr std::int64_t kChannelsOfAFilter = 2;  // with fewer, writing takes as long as reading
constexpr std::int64_t kMostRows = 14;          // of a tile's input
constexpr std::int64_t kMostChannels = 16;      // at a time
constexpr std::int64_t kLeastProducts = 8;      // between sums that are read and written
constexpr std::int64_t kRowSums = 8192;  // of a band of pixels: the longer its runs, the fewer begin anew
constexpr std::int64_t kLeastColumns = 512;
constexpr std::int64_t kFewBands = 8;  // with fewer, threads wait for each other

std::int64_t divide_up(std::int64_t a, std::int64_t b) { return (a + b - 1) / b; }
std::int64_t aligned(std::int64_t count) { return divide_up(count, kRowAlignment) * kRowAlignment; }

/// Near the root of all products, where the roundings within and of blocks are in balance.
std::int64_t block_channels_for(const Conv2dGeometry& g) {
  const std::int64_t taps = g.kheight * g.kwidth;
  const auto root = static_cast<std::int64_t>(std::sqrt(static_cast<double>(g.depth())));
  const std::int64_t channels = std::clamp<std::int64_t>(divide_up(std::max(root, kLeastProducts), taps), 1,
                                                         std::min(kMostChannels, g.ic));
  return divide_up(g.ic, divide_up(g.ic, channels));
}

/// Of a band of pixels.
std::int64_t row_columns(const Conv2dGeometry& g) {
  const std::int64_t part = std::max(kLeastColumns, divide_up(g.owidth, kFewBands));
  return std::min(g.owidth, aligned(std::min(part, kRowSums / g.oc)));
}

}  // namespace

bool Conv2dFewFilters::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  const bool odd = g.kheight == 3 || g.kheight == 5 || g.kheight == 7;
  return g.oc <= kMostFilters && g.ic >= kChannelsOfAFilter * g.oc && g.groups == 1 && g.stride_y == 1 &&
         g.stride_x == 1 && (odd || reads_once(g)) && !fusion.gate && !fusion.upsamples() &&
         !fusion.relu_input;
}

Conv2dFewFilters::Conv2dFewFilters(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                                   const Conv2dFusion& fusion)
    : routines_(routines),
      g_(with_rows_joined(geometry)),
      epilogue_(fusion, routines.isa),
      block_channels_(block_channels_for(g_)),
      tile_rows_(g_.kheight == 1 ? 1 : routines.filter_rows[g_.oc - 1]),
      phases_(std::min(g_.dilation_y, g_.oheight)),
      band_rows_(std::min(tile_rows_ * g_.dilation_y, g_.oheight)),
      band_columns_(g_.kheight == 1 ? row_columns(g_) : g_.owidth),
      column_bands_(divide_up(g_.owidth, band_columns_)),
      sum_step_(aligned(band_columns_)) {}

double Conv2dFewFilters::error_factor() const noexcept {
  const std::int64_t roundings = block_channels_ * g_.kheight * g_.kwidth +
                                 divide_up(g_.ic, block_channels_) + (routines_.fused ? 0 : 1);
  return 1.001 * static_cast<double>(roundings);  // (1 + u)^n - 1 <= 1.001·n·u for n < 2^14
}

double Conv2dFewFilters::macs() const noexcept {
  return static_cast<double>(g_.batch * g_.oc * g_.oplane()) * static_cast<double>(g_.depth());
}

std::size_t Conv2dFewFilters::packed_bytes() const noexcept {
  return static_cast<std::size_t>(g_.oc * g_.depth()) * sizeof(float);
}

void Conv2dFewFilters::pack(const float* weight, std::byte* packed) const {
  auto* to = static_cast<float*>(static_cast<void*>(packed));
  for (std::int64_t c = 0; c < g_.ic; ++c)
    for (std::int64_t v = 0; v < g_.kwidth; ++v)
      for (std::int64_t f = 0; f < g_.oc; ++f)
        for (std::int64_t u = 0; u < g_.kheight; ++u)
          *to++ = weight[((f * g_.ic + c) * g_.kheight + u) * g_.kwidth + v];
}

std::int64_t Conv2dFewFilters::band_count() const noexcept {
  return g_.batch * divide_up(g_.oheight, band_rows_) * column_bands_;
}

Conv2dFewFilters::Band Conv2dFewFilters::band(std::int64_t index) const noexcept {
  const std::int64_t column = index % column_bands_ * band_columns_;
  index /= column_bands_;
  const std::int64_t row_bands = divide_up(g_.oheight, band_rows_);
  return {index / row_bands, index % row_bands * band_rows_, column,
          std::min(band_columns_, g_.owidth - column)};
}

/// A row of zeros, where rows are missing.
std::int64_t Conv2dFewFilters::zeros_size() const noexcept { return g_.kheight == 1 ? 0 : aligned(g_.width); }

/// The sums of a band, those of its missing rows, too.
std::int64_t Conv2dFewFilters::thread_size() const noexcept {
  return g_.oc * tile_rows_ * phases_ * sum_step_ + zeros_size();
}

std::size_t Conv2dFewFilters::scratch_bytes() const noexcept {
  return static_cast<std::size_t>(std::min<std::int64_t>(thread_count(), band_count()) * thread_size()) *
         sizeof(float);
}

/// What of a plane a band reads, as far as rows are whole.
Conv2dFewFilters::Span Conv2dFewFilters::span_of(const Band& b) const noexcept {
  if (g_.kheight == 1) return {b.column, b.column + b.count};
  const std::int64_t first = b.row - g_.top;
  const std::int64_t last = first + band_rows_ + (g_.kheight - 1) * g_.dilation_y;
  return {std::clamp<std::int64_t>(first, 0, g_.height) * g_.width,
          std::clamp<std::int64_t>(last, 0, g_.height) * g_.width};
}

/// What is read behind the channels before `channel`: the following ones of this band, or the first ones of
/// the next.
FilterAhead Conv2dFewFilters::ahead_of(const Band& now, const Band& next, std::int64_t channel,
                                       const Conv2dArrays& arrays) const noexcept {
  const bool behind = channel == g_.ic;
  if (behind && next.image == g_.batch) return {};
  const Band& b = behind ? next : now;
  const std::int64_t first = behind ? 0 : channel;
  Span span = span_of(b);
  if (behind && next.image == now.image) span.first = std::max(span.first, span_of(now).last);
  const std::int64_t count = std::max<std::int64_t>(0, span.last - span.first);
  return {arrays.x + (b.image * g_.ic + first) * g_.plane() + span.first, count,
          aligned(divide_up(count, divide_up(b.count, kRowAlignment))),
          std::min(block_channels_, g_.ic - first), g_.plane()};
}

/// The products of tile.channels channels for the tile of a band that starts in its row `phase`.
void Conv2dFewFilters::add_tile(const Band& b, std::int64_t phase, const float* x, const float* zeros,
                                FilterTile& tile) const {
  std::array<const float*, kMostChannels * kMostRows> rows;
  auto* to = rows.data();
  const std::int64_t tile_inputs = tile_rows_ + g_.kheight - 1;
  for (std::int64_t c = 0; c < tile.channels; ++c, x += g_.plane())
    for (std::int64_t r = 0; r < tile_inputs; ++r) {
      const std::int64_t row = b.row + phase + r * g_.dilation_y - g_.top;
      *to++ = row >= 0 && row < g_.height ? x + row * g_.width + b.column : zeros;
    }
  tile.rows = rows.data();
  routines_.add_filters(tile);
}

void Conv2dFewFilters::write_band(const Band& b, const Conv2dArrays& arrays, float* sums) const {
  for (std::int64_t phase = 0; phase < phases_; ++phase)
    for (std::int64_t f = 0; f < g_.oc; ++f)
      for (std::int64_t k = 0; k < tile_rows_; ++k, sums += sum_step_) {
        const std::int64_t row = b.row + phase + k * g_.dilation_y;
        if (row >= g_.oheight) continue;
        const std::int64_t at = ((b.image * g_.oc + f) * g_.oheight + row) * g_.owidth + b.column;
        epilogue_.finish(sums, arrays.residual != nullptr ? arrays.residual + at : nullptr, arrays.y + at,
                         b.count);
      }
}

void Conv2dFewFilters::run_band(std::int64_t index, const Conv2dArrays& arrays, const float* zeros,
                                float* sums) const {
  const Band b = band(index);
  const Band next = band(index + 1);  // behind the last one: in no image
  const std::int64_t tile_sums = g_.oc * tile_rows_ * sum_step_;
  for (std::int64_t phase = 0; phase < phases_; ++phase)
    for (std::int64_t f = 0; f < g_.oc; ++f)
      std::fill_n(sums + phase * tile_sums + f * tile_rows_ * sum_step_, tile_rows_ * sum_step_,
                  arrays.bias != nullptr ? arrays.bias[f] : 0.0F);
  const auto* weight = static_cast<const float*>(static_cast<const void*>(arrays.packed));
  FilterTile tile{nullptr,   0,      g_.width, g_.left,   g_.dilation_x, g_.oc, g_.kheight,
                  g_.kwidth, weight, nullptr,  sum_step_, b.count,       {}};
  for (std::int64_t c = 0; c < g_.ic; c += block_channels_) {
    tile.channels = std::min(block_channels_, g_.ic - c);
    tile.weight = weight + c * g_.oc * g_.kheight * g_.kwidth;
    tile.ahead = ahead_of(b, next, c + tile.channels, arrays);
    for (std::int64_t phase = 0; phase < phases_; ++phase) {
      tile.sums = sums + phase * tile_sums;
      add_tile(b, phase, arrays.x + (b.image * g_.ic + c) * g_.plane(), zeros, tile);
      tile.ahead = {};  // all is asked for
    }
  }
  write_band(b, arrays, sums);
}

void Conv2dFewFilters::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
  auto* memory = static_cast<float*>(static_cast<void*>(scratch.data()));
  const std::int64_t slots = static_cast<std::int64_t>(scratch.size() / sizeof(float)) / thread_size();
  WorkRanges bands(band_count(), slots);
  parallel_for(slots, [&](std::int64_t slot) {
    float* sums = memory + slot * thread_size();
    float* zeros = sums + thread_size() - zeros_size();
    std::fill_n(zeros, zeros_size(), 0.0F);
    for (auto range = bands.take(slot); range.first < range.last; range = bands.take(slot))
      for (std::int64_t index = range.first; index < range.last; ++index)
        run_band(index, arrays, zeros, sums);
  });
}

}  // namespace slide::ops
