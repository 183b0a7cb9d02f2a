// Winograd convolutions of few tiles and many weights: the order of work reads weights once. A task
// multiplies a frequency's weights of some filters, as they lie in memory, with all tiles, which fit into the
// second-level cache; all products are kept, and transformed back when they are there.

#include <algorithm>
#include <atomic>

#include "ops/common/non_temporal.h"
#include "ops/conv2d/conv2d_winograd.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kTaskFilters = 128;   // of a frequency: each task reads its transformed tiles
constexpr std::int64_t kOutputFilters = 16;  // of a task that transforms products back

std::int64_t divide_up(std::int64_t a, std::int64_t b) { return (a + b - 1) / b; }

}  // namespace

void Conv2dWinogradBase::run_few_tiles(const Strip& strip, const Conv2dArrays& arrays, const float* v,
                                       float* products, float* memory, std::int64_t slots) const {
  const std::int64_t task_panels = std::max<std::int64_t>(kTaskFilters / panel_rows_, 1);
  const std::int64_t groups = divide_up(panels_, task_panels);
  std::atomic<std::int64_t> next_product{0};
  parallel_for(slots, [&](std::int64_t slot) {
    for (std::int64_t i = next_product++; i < frequencies_ * groups; i = next_product++) {
      const std::int64_t first_panel = i % groups * task_panels;
      multiply_frequency(strip, i / groups, first_panel, std::min(first_panel + task_panels, panels_),
                         arrays.packed, v, products, memory + slot * work_size());
    }
  });
  std::atomic<std::int64_t> next_filter{0};
  parallel_for(slots, [&](std::int64_t slot) {
    float* sums = memory + slot * work_size() + kRowAlignment;
    for (std::int64_t i = next_filter++; i < divide_up(g_.oc, kOutputFilters); i = next_filter++) {
      const std::int64_t first = i * kOutputFilters;
      for (std::int64_t panel = 0; panel < strip.panels; ++panel)
        transform_panel(strip, panel, first, std::min(first + kOutputFilters, g_.oc),
                        products + first * product_row_ + panel * columns_, arrays, sums);
    }
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
  p.sums = memory;
  p.c_stride = product_row_;
  for (std::int64_t panel = first_panel; panel < last_panel; ++panel) {
    p.a = static_cast<const float*>(static_cast<const void*>(packed)) +
          (frequency * panels_ + panel) * panel_size;
    p.c = products + panel * panel_rows_ * product_row_ + frequency * product_stride_;
    p.row_count = std::min(panel_rows_, g_.oc - panel * panel_rows_);
    multiplier_.multiply_filters(p);
  }
}

}  // namespace slide::ops
