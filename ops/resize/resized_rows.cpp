#include "ops/resize/resized_rows.h"

#include <algorithm>

namespace slide::ops {
namespace {

constexpr std::int64_t kRowsPerTask = 32;

}  // namespace

ResizeTables::ResizeTables(const ResizeOp& op, std::int64_t height, std::int64_t width)
    : in_width(width), out_width(op.params().size[1]), rows(op.axis(0, height)) {
  const ResizeAxis columns = op.axis(1, width);
  const auto taps = static_cast<std::size_t>(columns.taps);
  const std::size_t count = columns.index.size() / taps;
  column_index.resize(columns.index.size());
  column_weight.resize(columns.index.size());
  for (std::size_t j = 0; j < count; ++j)
    for (std::size_t k = 0; k < taps; ++k) {
      column_index[k * count + j] = static_cast<std::int32_t>(columns.index[j * taps + k]);
      column_weight[k * count + j] = static_cast<float>(columns.weight[j * taps + k]);
    }
}

ResizedRows::ResizedRows(const ResizeRoutines& routines, const ResizeTables& tables, const float* plane)
    : routines_(routines),
      tables_(tables),
      plane_(plane),
      memory_(static_cast<std::size_t>(tables.rows.taps * tables.out_width)) {
  held_.fill(-1);
}

const float* ResizedRows::along(std::int64_t row) {
  const std::int64_t slot = row % tables_.rows.taps;
  float* memory = memory_.data() + slot * tables_.out_width;
  std::int64_t& held = held_[static_cast<std::size_t>(slot)];
  if (held != row)
    routines_.along_row(plane_ + row * tables_.in_width, tables_.column_index.data(),
                        tables_.column_weight.data(), tables_.rows.taps, memory,
                        static_cast<std::size_t>(tables_.out_width));
  held = row;
  return memory;
}

void ResizedRows::write(std::int64_t i, float* y, const float* residual) {
  std::array<const float*, 4> sources{};
  std::array<float, 4> weights{};
  for (std::size_t k = 0; k < static_cast<std::size_t>(tables_.rows.taps); ++k) {
    const std::size_t at = static_cast<std::size_t>(i * tables_.rows.taps) + k;
    weights[k] = static_cast<float>(tables_.rows.weight[at]);
    sources[k] = along(tables_.rows.index[at]);
  }
  routines_.across_rows(sources.data(), weights.data(), tables_.rows.taps, residual, y,
                        static_cast<std::size_t>(tables_.out_width));
}

void resize_planes(const ResizeRoutines& routines, const ResizeOp& op, const Nchw& in, const float* x,
                   const float* residual, float* y) {
  const std::int64_t height = op.params().size[0], width = op.params().size[1];
  const ResizeTables tables(op, in.h, in.w);
  const std::int64_t tasks = (height + kRowsPerTask - 1) / kRowsPerTask;
  for_ranges(in.n * in.c * tasks, 1, [&](std::int64_t task, std::int64_t) {
    const std::int64_t plane = task / tasks;
    ResizedRows rows(routines, tables, x + plane * in.plane());
    const std::int64_t first = task % tasks * kRowsPerTask;
    for (std::int64_t i = first; i < std::min(height, first + kRowsPerTask); ++i) {
      const std::int64_t at = (plane * height + i) * width;
      rows.write(i, y + at, residual != nullptr ? residual + at : nullptr);
    }
  });
}

}  // namespace slide::ops
