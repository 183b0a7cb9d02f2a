#include "ops/conv2d/direct/direct.h"

#include <algorithm>

#include "runtime/threads.h"

namespace slide::ops {

/// Whether nothing is left to do after the sums but what the product does: then it writes to y.
bool Conv2dDirect::writes_y() const noexcept { return !gated_ && !upsampled_ && epilogue_.empty(nullptr); }

namespace {
const std::int32_t* integers(const float* words) {
  return static_cast<const std::int32_t*>(static_cast<const void*>(words));
}
}  // namespace

/// Words k, ... of a task's weights.
Conv2dDirect::Block Conv2dDirect::block(const Call& call, const Task& t, std::int64_t k) const noexcept {
  const std::int64_t depth = std::min(block_depth_, depth_ - k);
  const std::int64_t group = t.variant * g_.groups + t.group;
  const auto* packed = static_cast<const float*>(static_cast<const void*>(call.arrays.packed));
  const std::int64_t channel = t.image * g_.oc + t.group * g_.group_oc;
  const bool to_y = writes_y();
  return {depth,
          k == 0,
          k + depth == depth_,
          to_y,
          to_y ? g_.oplane() : routines_.columns,
          group * panels_ * routines_.rows,
          channel * g_.oplane() + t.first_row * columns_out_,
          packed + words_at(group * panels_, k),
          rest_size() > 0 ? integers(packed + rests_at(group * panels_, k)) : nullptr};
}

/// A panel of weights times positions that fill at most one panel of columns. Shallow products
/// take a hundred cycles: this is part of the loops around it.
[[gnu::always_inline]] inline void Conv2dDirect::multiply(const Call& call, const Task& t, const Block& block,
                                                          std::int64_t panel, const Columns& columns,
                                                          float* sums, const Ahead& ahead) const {
  const std::int64_t rows = routines_.rows;
  const std::int64_t first_row = panel * rows;
  const std::int64_t row = block.row + first_row;
  const std::int64_t at = block.at + first_row * g_.oplane() + columns.first;
  const float* residual = block.to_y && call.arrays.residual != nullptr ? call.arrays.residual + at : nullptr;
  const auto multiply_words = routines_.multiply_words[static_cast<std::size_t>(precision_)];
  multiply_words({.a = block.a + first_row * filled(block.depth),
                  .b = columns.b,
                  .offsets = columns.offsets,
                  .depth = block.depth,
                  .row_count = std::min(rows, g_.group_oc - first_row),
                  .column_count = columns.count,
                  .first = block.first,
                  .last = block.last,
                  .rests = block.rests != nullptr ? block.rests + panel * rest_size() : nullptr,
                  .start = call.starts + row,
                  .sums = sums,
                  .step = call.steps + row,
                  .bias = call.biases + row,
                  .residual = residual,
                  .residual_last = residual_last_,
                  .low = epilogue_.low(),
                  .high = epilogue_.high(),
                  .y = block.to_y ? call.arrays.y + at : sums,
                  .y_stride = block.y_stride,
                  .ahead = ahead.x,
                  .ahead_count = ahead.rows > 0 ? ahead.count : 0});
  if (block.last && !block.to_y) write_rows(call, t, panel, columns.first, columns.count, sums);
}

/// What comes after the sums of a panel.
void Conv2dDirect::write_rows(const Call& call, const Task& t, std::int64_t panel, std::int64_t first,
                              std::int64_t count, float* sums) const {
  const std::int64_t first_row = panel * routines_.rows;
  const std::int64_t last_row = std::min(first_row + routines_.rows, g_.group_oc);
  const std::int64_t channels = gated_ ? g_.oc / 2 : g_.oc;
  const Conv2dArrays& arrays = call.arrays;
  for (std::int64_t row = first_row; row < last_row; row += gated_ ? 2 : 1) {
    float* from = sums + (row - first_row) * routines_.columns;
    const std::int64_t plane = (t.image * channels + filter_of_row(g_, gated_, t.group, row)) * g_.oplane();
    if (gated_) routines_.gate(from, from + routines_.columns, from, count);
    if (upsampled_) {
      write_upsampled(call, t, plane, first, count, from);
      continue;
    }
    const std::int64_t at = plane + t.first_row * columns_out_ + first;
    epilogue_.finish(from, arrays.residual != nullptr ? arrays.residual + at : nullptr, arrays.y + at, count);
  }
}

/// Sums of one parity of rows and columns.
void Conv2dDirect::write_upsampled(const Call& call, const Task& t, std::int64_t plane, std::int64_t first,
                                   std::int64_t count, float* sums) const {
  const Conv2dArrays& arrays = call.arrays;
  for (std::int64_t done = 0; done < count;) {
    const std::int64_t i = (first + done) / columns_out_;
    const std::int64_t j = (first + done) % columns_out_;
    const std::int64_t length = std::min(count - done, columns_out_ - j);
    float* from = sums + done;
    done += length;
    const std::int64_t at = plane + (2 * i + t.variant / 2) * g_.owidth + 2 * j + t.variant % 2;
    std::array<float, 64> residual;
    for (std::int64_t n = 0; arrays.residual != nullptr && n < length; ++n)
      residual[static_cast<std::size_t>(n)] = arrays.residual[at + 2 * n];
    epilogue_.finish(from, arrays.residual != nullptr ? residual.data() : nullptr, from, length);
    for (std::int64_t n = 0; n < length; ++n) arrays.y[at + 2 * n] = from[n];
  }
}

/// Few filters: the planes of a block of the depth are made, then multiplied where they lie.
void Conv2dDirect::run_streaming(const Call& call, const Task& t, float* memory) const {
  const std::int64_t columns = routines_.columns;
  const std::int64_t phases = g_.stride_y * g_.stride_x;
  const std::int64_t first_word = (t.image * g_.groups + t.group) * group_words_;
  const std::int64_t rows = std::min(strip_rows_, rows_out_ - t.first_row) + reach_y_;
  const std::int64_t words = local_ ? block_depth_ / taps_ : 0;
  for (std::int64_t k = 0; k < depth_; k += block_depth_) {
    for (std::int64_t word = 0; word < std::min(words, group_words_ - k / taps_); ++word)
      fill_plane(call, first_word + k / taps_ + word, t.first_row, rows,
                 memory + word * phases * plane_size_);
    const float* planes = local_ ? memory : call.arrays.x + first_word * g_.plane();
    const Block of_k = block(call, t, k);
    float* sums = memory + strip_planes();
    for (std::int64_t first = t.first, count = 0; first < t.first + t.count; first += count) {
      const std::int64_t column = first % columns_out_;
      count = panel_columns(first, t.first + t.count);
      const Columns at{first, count, planes + first / columns_out_ * plane_width_ + column,
                       offsets_.data() + (local_ ? 0 : k)};
      for (std::int64_t panel = t.first_panel; panel < t.last_panel;
           ++panel, sums += routines_.rows * columns)
        multiply(call, t, of_k, panel, at, sums, {});
    }
  }
}

/// The gathered words k, ... of positions that fill at most one panel of columns, and zeros behind the depth.
void Conv2dDirect::gather_panel(const Call& call, const Task& t, std::int64_t first, std::int64_t count,
                                std::int64_t k, const float* planes, float* b) const {
  gather_words(call, t, first, count, k, planes, b);
  const std::int64_t depth = std::min(block_depth_, depth_ - k);
  std::fill(b + depth * routines_.columns, b + filled(depth) * routines_.columns, 0.0F);
}

void Conv2dDirect::gather_words(const Call& call, const Task& t, std::int64_t first, std::int64_t count,
                                std::int64_t k, const float* planes, float* b) const {
  std::array<WordRun, 64> runs;
  std::int64_t run_count = 0;
  const std::int64_t row_size = in_place_ ? g_.stride_y * in_width_ : plane_width_;
  const std::int64_t stride = in_place_ ? g_.stride_x : 1;
  for (std::int64_t done = 0; done < count;) {
    const std::int64_t column = (first + done) % columns_out_;
    const std::int64_t length = std::min(count - done, columns_out_ - column);
    runs[static_cast<std::size_t>(run_count++)] = {(first + done) / columns_out_ * row_size + column * stride,
                                                   done, length};
    done += length;
  }
  const std::int64_t depth = std::min(block_depth_, depth_ - k);
  const std::int32_t* offsets = offsets_.data() + t.variant * depth_ + k;
  const Quantiser& q = call.quantiser;
  if (!in_place_) {
    const WordGather words{{planes, 0, 0, 0, 1, 0}, offsets, runs.data(), run_count, 1};
    routines_.gather_copies(words, depth, b);
    return;
  }
  const float* x = call.arrays.x + (t.image * g_.ic + t.group * g_.group_ic) * g_.plane();
  const WordGather words{{x, g_.plane(), g_.group_ic - k * lanes_, q.zero, 1 / q.step, least_},
                         offsets,
                         runs.data(),
                         run_count,
                         stride};
  routines_.gather[static_cast<std::size_t>(precision_)](words, depth, b);
}

/// The words k, ... of a panel's columns: in the planes, or gathered now.
void Conv2dDirect::find_words(const Call& call, const Task& t, std::int64_t k, const float* planes,
                              float* gathered, Columns& columns) const {
  if (in_rows_) {
    columns.b = planes + columns.first / columns_out_ * plane_width_ + columns.first % columns_out_;
    columns.offsets = offsets_.data() + t.variant * depth_ + k;
  } else {
    gather_panel(call, t, columns.first, columns.count, k, planes, gathered);
    columns.b = gathered;
  }
}

/// What the words k, ... are made of from position `first` of a strip on. Behind a task's last one come those
/// of the next task, which this thread will probably take.
Conv2dDirect::Ahead Conv2dDirect::ahead_of(const Call& call, const Task& t, std::int64_t first,
                                           std::int64_t k) const noexcept {
  if (!fetches_) return {};
  const std::int64_t count = std::min(tile_positions_, g_.oplane() - first);
  if (count <= 0) return {};
  const std::int64_t channel = t.group * g_.group_ic + k * lanes_;
  return {call.arrays.x + (t.image * g_.ic + channel) * g_.plane() + first, count,
          std::min(block_depth_ * lanes_, g_.group_ic - k * lanes_)};
}

/// Many filters: a block of the depth of some positions stays in the first-level cache and is multiplied by
/// all of them.
void Conv2dDirect::run_gathered(const Call& call, const Task& t, float* memory) const {
  const std::int64_t columns = routines_.columns;
  const std::int64_t phases = g_.stride_y * g_.stride_x;
  const std::int64_t first_word = (t.image * g_.groups + t.group) * group_words_;
  const std::int64_t rows = std::min(strip_rows_, rows_out_ - t.first_row) + reach_y_;
  for (std::int64_t word = 0; local_ && word < group_words_; ++word)
    fill_plane(call, first_word + word, t.first_row, rows, memory + word * phases * plane_size_);
  const float* planes = local_ ? memory : call.planes + first_word * phases * plane_size_;
  float* const gathered = memory + strip_planes();
  float* const tile = gathered + (in_rows_ ? 0 : block_depth_ * tile_positions_ + kRowAlignment);
  const std::int64_t end = t.first + t.count;
  const auto most = static_cast<std::size_t>(tile_positions_ / columns);
  std::array<Columns, kTilePanels> panels;
  for (std::int64_t first = t.first; first < end;) {
    std::size_t count = 0;
    for (; first < end && count < most; ++count) {
      panels[count] = {first, panel_columns(first, end), nullptr, nullptr};
      first += panels[count].count;
    }
    for (std::int64_t k = 0; k < depth_; k += block_depth_) {
      const Block of_k = block(call, t, k);
      Ahead ahead =
          of_k.last ? ahead_of(call, t, first, 0) : ahead_of(call, t, panels[0].first, k + of_k.depth);
      float* b = gathered;
      for (std::size_t i = 0; i < count; ++i, b += columns * block_depth_)
        find_words(call, t, k, planes, b, panels[i]);
      float* sums = tile;
      for (std::int64_t panel = t.first_panel; panel < t.last_panel; ++panel)
        for (std::size_t i = 0; i < count; ++i, sums += routines_.rows * columns) {
          multiply(call, t, of_k, panel, panels[i], sums, ahead);
          ahead.x += ahead.rows > 1 ? g_.plane() : 0;
          --ahead.rows;
        }
    }
  }
}

void Conv2dDirect::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
  if (task_count() == 0) return;
  auto* memory = static_cast<float*>(static_cast<void*>(scratch.data()));
  const std::int64_t rows = rows_size();
  float* const planes = memory + 3 * rows;
  const Call call{arrays, quantiser(arrays), memory, memory + rows, memory + 2 * rows, planes};
  make_row_values(call);
  const std::int64_t phases = g_.stride_y * g_.stride_x;
  if (shared_planes() > 0)
    parallel_for(g_.batch * g_.groups * group_words_, [&](std::int64_t word) {
      fill_plane(call, word, 0, rows_out_ + reach_y_, planes + word * phases * plane_size_);
    });
  float* const tasks = planes + shared_planes();
  const std::int64_t rest = static_cast<std::int64_t>(scratch.size() / sizeof(float)) - (tasks - memory);
  const std::int64_t slots = std::min<std::int64_t>(task_count(), rest / thread_size());
  WorkRanges ranges(task_count(), slots);
  parallel_for(std::min(task_count(), slots), [&](std::int64_t slot) {
    float* own = tasks + slot * thread_size();
    routines_.begin_products();
    for (WorkRanges::Range r = ranges.take(slot); r.first < r.last; r = ranges.take(slot))
      for (std::int64_t i = r.first; i < r.last; ++i) {
        if (streaming_)
          run_streaming(call, task(i), own);
        else
          run_gathered(call, task(i), own);
      }
    routines_.end_products();
  });
  spoil(call);
}

}  // namespace slide::ops
