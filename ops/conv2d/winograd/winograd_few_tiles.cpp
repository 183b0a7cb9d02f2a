// Winograd convolutions of few tiles and many weights: the order of work reads weights once. A task
// multiplies a frequency's weights of some filters, as they lie in memory, with all tiles, which fit into the
// second-level cache; all products are kept, and transformed back when they are there. Many weights are
// transformed on the way: a task takes some filters, and of them some words after the other, so that memory
// holds and delivers nine numbers instead of sixteen or thirty-six.

#include <algorithm>

#include "ops/common/non_temporal.h"
#include "ops/conv2d/winograd/winograd.h"
#include "ops/conv2d/winograd/winograd_filters.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kTaskFilters = 128;   // of a frequency: each task reads its transformed tiles
constexpr std::int64_t kOutputFilters = 16;  // of a task that transforms products back
constexpr std::int64_t kSkew = 16;           // frequencies at a distance of powers of two would share a set

std::int64_t divide_up(std::int64_t a, std::int64_t b) { return (a + b - 1) / b; }

}  // namespace

void Conv2dWinogradBase::run_few_tiles(const Strip& strip, const Conv2dArrays& arrays, const float* v,
                                       float* products, float* memory, std::int64_t slots) const {
  const std::int64_t task_panels = std::max<std::int64_t>(kTaskFilters / panel_rows_, 1);
  const std::int64_t groups = divide_up(panels_, task_panels);
  const std::int64_t tasks = late_ ? panels_ : frequencies_ * groups;
  const std::int64_t size = work_size();
  parallel_for(tasks, slots, [&](std::int64_t i, std::int64_t slot) {
    float* own = memory + slot * size;
    if (late_) return multiply_late(strip, i, arrays.packed, v, products, own);
    const std::int64_t first_panel = i % groups * task_panels;
    multiply_frequency(strip, i / groups, first_panel, std::min(first_panel + task_panels, panels_),
                       arrays.packed, v, products, own);
  });
  parallel_for(divide_up(g_.oc, kOutputFilters), slots, [&](std::int64_t i, std::int64_t slot) {
    float* sums = memory + slot * size + kRowAlignment;
    const std::int64_t first = i * kOutputFilters;
    for (std::int64_t panel = 0; panel < strip.panels; ++panel)
      transform_panel(strip, panel, first, std::min(first + kOutputFilters, g_.oc),
                      products + first * product_row_ + panel * columns_, arrays, sums);
    if (non_temporal_) non_temporal_fence();
  });
}

void Conv2dWinogradBase::multiply_frequency(const Strip& strip, std::int64_t frequency,
                                            std::int64_t first_panel, std::int64_t last_panel,
                                            const std::byte* packed, const float* v, float* products,
                                            float* memory) const {
  const std::int64_t panel_size = words_ * panel_rows_;
  WinogradFilterProduct p{};
  p.b = v + frequency * strip.frequency_stride;
  p.columns = columns_;
  p.panel_stride = strip.panel_stride;
  p.depth = words_;
  p.block = block_depth_;
  p.tiles = strip.tiles();
  p.last = true;
  p.sums = memory;
  p.c_stride = product_row_;
  for (std::int64_t panel = first_panel; panel < last_panel; ++panel) {
    p.a = static_cast<const float*>(static_cast<const void*>(packed)) +
          (frequency * panels_ + panel) * panel_size;
    p.ahead = p.a + panel_size;
    p.ahead_step = panel_rows_;
    p.c = products + panel * panel_rows_ * product_row_ + frequency * product_stride_;
    p.row_count = std::min(panel_rows_, g_.oc - panel * panel_rows_);
    multiplier_.multiply_filters(p);
  }
}

/// Floats from frequency to frequency of some words' transformed weights.
std::int64_t Conv2dWinogradBase::late_stride() const noexcept {
  return std::min(kLateWords, words_) * panel_rows_ + kSkew;
}

/// Floats of these weights and of the sums.
std::int64_t Conv2dWinogradBase::late_size() const noexcept {
  return frequencies_ * (late_stride() + panel_rows_ * product_stride_);
}

/// All frequencies of a panel of filters.
void Conv2dWinogradBase::multiply_late(const Strip& strip, std::int64_t panel, const std::byte* packed,
                                       const float* v, float* products, float* memory) const {
  static_assert(kLateWords % kPackedWords == 0);
  const WinogradFilterMatrix g = winograd_filter_matrix(tile_);
  const WinogradFilterRoutines& filters = winograd_filters_at(routines_.isa);
  const WinogradFilters transform =
      (precision_ == Precision::kFp32 ? filters.transform : filters.transform_words)[tile_ / 2 - 1];
  const auto* taps =
      static_cast<const float*>(static_cast<const void*>(packed)) + panel * words_ * 9 * panel_rows_;
  WinogradFilterProduct p{};
  p.columns = columns_;
  p.panel_stride = strip.panel_stride;
  p.block = block_depth_;
  p.tiles = strip.tiles();
  p.c_stride = product_row_;
  p.row_count = std::min(panel_rows_, g_.oc - panel * panel_rows_);
  for (std::int64_t k = 0; k < words_; k += kLateWords) {
    p.depth = std::min(kLateWords, words_ - k);
    for (std::int64_t first = 0; first < p.depth; first += kPackedWords) {
      const std::int64_t count = std::min(kPackedWords, p.depth - first) * panel_rows_;
      transform(g, taps, count, memory + first * panel_rows_, late_stride());
      taps += 9 * count;
    }
    p.add = k > 0;
    p.last = k + p.depth == words_;
    for (std::int64_t f = 0; f < frequencies_; ++f) {
      p.a = memory + f * late_stride();
      p.ahead_step = divide_up(9 * panel_rows_, frequencies_);
      p.ahead = taps + f * p.ahead_step * kLateWords;
      p.b = v + f * strip.frequency_stride + k * columns_;
      p.sums = memory + frequencies_ * late_stride() + f * panel_rows_ * product_stride_;
      p.c = products + panel * panel_rows_ * product_row_ + f * product_stride_;
      multiplier_.multiply_filters(p);
    }
  }
}

}  // namespace slide::ops
