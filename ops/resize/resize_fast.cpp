// Rows are resampled along their length first, each once for a run of output rows that need it: input rows
// that follow each other are kept in as many slots as there are taps, row r in slot r mod taps.

#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/resize/resize_op.h"
#include "ops/resize/resize_routines.h"
#include "ops/simd/dispatch.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)  \
  namespace level {                       \
  extern const ResizeRoutines resampling; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const ResizeRoutines* const> resize_routines() {
#define SLIDE_LIST(level, enumerator) &level::resampling,
  static constexpr const ResizeRoutines* kAll[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return kAll;
}

namespace {

constexpr std::int64_t kRowsPerTask = 32;

/// A row's table in the order the kernels read it.
struct RowTable {
  std::vector<std::int32_t> index;
  std::vector<float> weight;
};

RowTable row_table(const ResizeAxis& axis) {
  const auto taps = static_cast<std::size_t>(axis.taps);
  const std::size_t count = axis.index.size() / taps;
  RowTable table{std::vector<std::int32_t>(axis.index.size()), std::vector<float>(axis.index.size())};
  for (std::size_t j = 0; j < count; ++j)
    for (std::size_t k = 0; k < taps; ++k) {
      table.index[k * count + j] = static_cast<std::int32_t>(axis.index[j * taps + k]);
      table.weight[k * count + j] = static_cast<float>(axis.weight[j * taps + k]);
    }
  return table;
}

/// The last few input rows, resampled along their length.
class RowCache {
 public:
  RowCache(int taps, std::int64_t width)
      : taps_(taps),
        width_(static_cast<std::size_t>(width)),
        memory_(static_cast<std::size_t>(taps) * width_) {
    held_.fill(-1);
  }
  /// The slot of a row; `fill` is called with it if another row was there.
  template <typename Fill>
  const float* row(std::int64_t index, Fill fill) {
    const auto slot = static_cast<std::size_t>(index % taps_);
    float* memory = memory_.data() + slot * width_;
    if (held_[slot] != index) fill(memory);
    held_[slot] = index;
    return memory;
  }

 private:
  int taps_;
  std::size_t width_;
  std::vector<float> memory_;
  std::array<std::int64_t, 4> held_{};
};

class ResizeKernel : public LevelKernel<ResizeOp, ResizeRoutines> {
 public:
  using LevelKernel::LevelKernel;
  [[nodiscard]] bool supports(const Op& /*op*/, std::span<const Shape> inputs,
                              const Shape& /*output*/) const override {
    return inputs[0][3] <= std::numeric_limits<std::int32_t>::max();
  }

 private:
  /// In each direction the weights are rounded, then the products, then taps - 1 sums. Nearest copies.
  [[nodiscard]] double factor(const ResizeOp& op, std::span<const Shape> /*inputs*/) const override {
    switch (op.params().mode) {
      case ResizeMode::kNearest:
        return 0;
      case ResizeMode::kLinear:
        return rounding_factor(2 * 3);
      case ResizeMode::kCubic:
        return rounding_factor(2 * 5);
    }
    return 0;
  }

  void compute(const ResizeOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const Nchw in = nchw(inputs[0].shape());
    const Nchw out = nchw(output.shape());
    const ResizeAxis rows = op.axis(0, in.h);
    const RowTable columns = row_table(op.axis(1, in.w));
    const std::int64_t tasks = (out.h + kRowsPerTask - 1) / kRowsPerTask;
    for_ranges(in.n * in.c * tasks, 1, [&](std::int64_t task, std::int64_t) {
      const std::int64_t plane = task / tasks;
      const std::int64_t first = task % tasks * kRowsPerTask;
      const float* x = f32(inputs[0]) + plane * in.plane();
      float* y = f32(output) + plane * out.plane();
      RowCache cache(rows.taps, out.w);
      for (std::int64_t i = first; i < std::min(out.h, first + kRowsPerTask); ++i)
        resize_row(rows, columns, in, out, x, i, cache, y + i * out.w);
    });
  }

  void resize_row(const ResizeAxis& rows, const RowTable& columns, const Nchw& in, const Nchw& out,
                  const float* x, std::int64_t i, RowCache& cache, float* y) const {
    const auto width = static_cast<std::size_t>(out.w);
    std::array<const float*, 4> sources{};
    std::array<float, 4> weights{};
    for (std::size_t k = 0; k < static_cast<std::size_t>(rows.taps); ++k) {
      const std::size_t at = static_cast<std::size_t>(i * rows.taps) + k;
      const std::int64_t row = rows.index[at];
      weights[k] = static_cast<float>(rows.weight[at]);
      sources[k] = cache.row(row, [&](float* to) {
        routines().along_row(x + row * in.w, columns.index.data(), columns.weight.data(), rows.taps, to,
                             width);
      });
    }
    routines().across_rows(sources.data(), weights.data(), rows.taps, y, width);
  }
};

}  // namespace

std::span<const Kernel* const> ResizeOp::kernels() const {
  static const KernelList<ResizeKernel, ResizeRoutines> list("resize.separable", resize_routines());
  return list.all();
}

}  // namespace slide::ops
