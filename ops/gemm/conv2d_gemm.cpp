#include "ops/gemm/conv2d_gemm.h"

#include <algorithm>
#include <cmath>

#include "runtime/threads.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kMinBlockDepth = 32;  // below it, adding blocks costs more than it gains in accuracy
constexpr std::int64_t kFewTasks = 16;       // with fewer, output channels are split, too
constexpr std::int64_t kMinTaskPanels = 4;

std::int64_t divide_up(std::int64_t a, std::int64_t b) { return (a + b - 1) / b; }

std::int64_t block_depth_for(std::int64_t depth) {
  const auto root = static_cast<std::int64_t>(std::ceil(std::sqrt(static_cast<double>(depth))));
  return std::min(depth, std::max(kMinBlockDepth, divide_up(root, 8) * 8));
}

}  // namespace

struct Conv2dGemm::Task {
  std::int64_t image, group;
  std::int64_t first_panel, last_panel;  // of weights
  std::int64_t first, count;             // positions
};

Conv2dGemm::Conv2dGemm(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                       const Conv2dFusion& fusion)
    : routines_(routines),
      g_(with_rows_joined(geometry)),
      gated_(fusion.gate),
      relu_input_(fusion.relu_input),
      relu_(unary_row(UnaryOp(UnaryKind::kRelu), pointwise_routines_of(routines.isa))),
      epilogue_(fusion, routines.isa),
      depth_(g_.depth()),
      block_depth_(block_depth_for(depth_)),
      panels_(divide_up(g_.group_oc, routines.rows)),
      task_panels_(panels_),
      row_tasks_(1),
      tiles_(divide_up(g_.oplane(), routines.columns)) {
  const std::int64_t tasks = g_.batch * g_.groups * tiles_;
  if (tasks >= kFewTasks || tasks == 0) return;
  task_panels_ = std::clamp(panels_ * tasks / kFewTasks, std::min(kMinTaskPanels, panels_), panels_);
  row_tasks_ = divide_up(panels_, task_panels_);
}

double Conv2dGemm::error_factor() const noexcept {
  const std::int64_t roundings = block_depth_ + divide_up(depth_, block_depth_) + (routines_.fused ? 0 : 1);
  return 1.001 * static_cast<double>(roundings);  // (1 + u)^n - 1 <= 1.001·n·u for n < 2^14
}

std::size_t Conv2dGemm::scratch_bytes() const noexcept {
  const std::int64_t thread = (block_depth_ + task_panels_ * routines_.rows) * routines_.columns;
  const std::int64_t tasks = g_.batch * g_.groups * tiles_ * row_tasks_;
  const std::int64_t threads = std::min<std::int64_t>(thread_count(), tasks);
  return static_cast<std::size_t>(threads * thread) * sizeof(float);
}

std::size_t Conv2dGemm::packed_bytes() const noexcept {
  return static_cast<std::size_t>(g_.groups * panels_ * depth_ * routines_.rows) * sizeof(float);
}

double Conv2dGemm::macs() const noexcept {
  return static_cast<double>(g_.batch * g_.oc * g_.oplane()) * static_cast<double>(depth_);
}

Conv2dGemm::Task Conv2dGemm::task(std::int64_t index) const noexcept {
  Task t{};
  const std::int64_t run = index % row_tasks_;
  index /= row_tasks_;
  t.first_panel = run * task_panels_;
  t.last_panel = std::min(t.first_panel + task_panels_, panels_);
  t.first = index % tiles_ * routines_.columns;
  t.count = std::min(routines_.columns, g_.oplane() - t.first);
  t.group = index / tiles_ % g_.groups;
  t.image = index / tiles_ / g_.groups;
  return t;
}

/// Panels of `rows` output channels, in each the weights k by k; zeros below the last channel.
void Conv2dGemm::pack(const float* weight, std::byte* packed) const {
  const std::int64_t rows = routines_.rows;
  auto* panels = static_cast<float*>(static_cast<void*>(packed));
  parallel_for(g_.groups * panels_, [&](std::int64_t panel) {
    const std::int64_t first = panel % panels_ * rows;
    float* to = panels + panel * depth_ * rows;
    for (std::int64_t m = 0; m < rows; ++m) {
      const bool inside = first + m < g_.group_oc;
      const float* from =
          inside ? weight + filter_of_row(g_, gated_, panel / panels_, first + m) * depth_ : nullptr;
      for (std::int64_t k = 0; k < depth_; ++k) to[k * rows + m] = inside ? from[k] : 0.0F;
    }
  });
}

void Conv2dGemm::run_task(const Task& t, const Conv2dArrays& arrays, float* memory) const {
  const auto* packed = static_cast<const float*>(static_cast<const void*>(arrays.packed));
  const std::int64_t rows = routines_.rows;
  const std::int64_t columns = routines_.columns;
  float* b = memory;
  float* tile = memory + block_depth_ * columns;
  const std::int64_t last_row = std::min(t.last_panel * rows, g_.group_oc);
  for (std::int64_t row = t.first_panel * rows; row < t.last_panel * rows; ++row) {
    const bool biased = arrays.bias != nullptr && row < last_row;
    std::fill_n(tile + (row - t.first_panel * rows) * columns, columns,
                biased ? arrays.bias[filter_of_row(g_, gated_, t.group, row)] : 0.0F);
  }
  const ColumnSource source{arrays.x + (t.image * g_.ic + t.group * g_.group_ic) * g_.plane(),
                            g_.height,
                            g_.width,
                            g_.owidth,
                            g_.kheight,
                            g_.kwidth,
                            g_.stride_y,
                            g_.stride_x,
                            g_.dilation_y,
                            g_.dilation_x,
                            g_.top,
                            g_.left};
  for (std::int64_t k = 0; k < depth_; k += block_depth_) {
    const std::int64_t last_k = std::min(k + block_depth_, depth_);
    routines_.pack_columns(source, t.first, t.count, k, last_k, b);
    if (relu_input_) relu_(b, b, static_cast<std::size_t>((last_k - k) * columns));
    for (std::int64_t panel = t.first_panel; panel < t.last_panel; ++panel)
      routines_.multiply(packed + ((t.group * panels_ + panel) * depth_ + k) * rows, b, last_k - k,
                         tile + (panel - t.first_panel) * rows * columns,
                         std::min(rows, last_row - panel * rows), t.count);
  }
  write_tile(t, tile, arrays);
}

void Conv2dGemm::write_tile(const Task& t, float* tile, const Conv2dArrays& arrays) const {
  const std::int64_t columns = routines_.columns;
  const std::int64_t first_row = t.first_panel * routines_.rows;
  const std::int64_t last_row = std::min(t.last_panel * routines_.rows, g_.group_oc);
  const std::int64_t channels = gated_ ? g_.oc / 2 : g_.oc;
  for (std::int64_t row = first_row; row < last_row; row += gated_ ? 2 : 1) {
    float* from = tile + (row - first_row) * columns;
    const std::int64_t at =
        (t.image * channels + filter_of_row(g_, gated_, t.group, row)) * g_.oplane() + t.first;
    if (gated_) routines_.gate(from, from + columns, from, t.count);
    epilogue_.finish(from, arrays.residual != nullptr ? arrays.residual + at : nullptr, arrays.y + at,
                     t.count);
  }
}

void Conv2dGemm::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
  const std::int64_t tasks = g_.batch * g_.groups * tiles_ * row_tasks_;
  if (tasks == 0) return;
  const std::int64_t thread_size = (block_depth_ + task_panels_ * routines_.rows) * routines_.columns;
  auto* memory = static_cast<float*>(static_cast<void*>(scratch.data()));
  const std::int64_t slots = static_cast<std::int64_t>(scratch.size() / sizeof(float)) / thread_size;
  parallel_for(tasks, slots, [&](std::int64_t i, std::int64_t slot) {
    run_task(task(i), arrays, memory + slot * thread_size);
  });
}

}  // namespace slide::ops
