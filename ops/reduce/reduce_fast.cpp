#include <algorithm>
#include <limits>
#include <vector>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/reduce/reduce_op.h"
#include "ops/reduce/reduce_routines.h"
#include "ops/simd/dispatch.h"
#include "runtime/threads.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)  \
  namespace level {                       \
  extern const ReduceRoutines reductions; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const ReduceRoutines* const> reduce_routines() {
#define SLIDE_LIST(level, enumerator) &level::reductions,
  static constexpr const ReduceRoutines* kAll[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return kAll;
}

namespace {

/// The axes of a reduction with neighbours that are treated alike merged, and those of extent 1 left out.
struct MergedAxis {
  std::int64_t extent;
  bool reduced;
};

std::vector<MergedAxis> merged_axes(const ReduceOp& op, const Shape& shape) {
  const auto reduced = op.reduced(shape);
  std::vector<MergedAxis> axes;
  for (int axis = 0; axis < shape.rank(); ++axis) {
    const bool flag = reduced[static_cast<std::size_t>(axis)];
    if (shape[axis] == 1) continue;
    if (!axes.empty() && axes.back().reduced == flag)
      axes.back().extent *= shape[axis];
    else
      axes.push_back({shape[axis], flag});
  }
  if (axes.empty()) axes.push_back({1, true});
  return axes;
}

/// Walks through the rows of the input along its last merged axis. `row` is given each row and where it goes
/// in the output: element by element, or `whole` into one element where that axis is reduced.
class Walk {
 public:
  using Row = std::function<void(const float* x, std::int64_t to, std::int64_t count, bool whole)>;
  Walk(std::vector<MergedAxis> axes, Row row) : axes_(std::move(axes)), row_(std::move(row)) {
    in_.resize(axes_.size());
    out_.resize(axes_.size());
    std::int64_t in = 1;
    std::int64_t out = 1;
    for (std::size_t i = axes_.size(); i-- > 0;) {
      in_[i] = in;
      out_[i] = out;
      in *= axes_[i].extent;
      if (!axes_[i].reduced) out *= axes_[i].extent;
    }
  }

  /// Everything; in parallel along the first axis if that one is kept, so that no two threads meet.
  void run(const float* x) const {
    if (axes_.size() > 1 && !axes_[0].reduced)
      parallel_for(axes_[0].extent, [&](std::int64_t i) { visit(1, x + i * in_[0], i * out_[0]); });
    else
      visit(0, x, 0);
  }

 private:
  void visit(std::size_t axis, const float* x, std::int64_t to) const {
    const MergedAxis& a = axes_[axis];
    if (axis + 1 == axes_.size()) {
      row_(x, to, a.extent, a.reduced);
      return;
    }
    for (std::int64_t i = 0; i < a.extent; ++i)
      visit(axis + 1, x + i * in_[axis], a.reduced ? to : to + i * out_[axis]);
  }

  std::vector<MergedAxis> axes_;
  Row row_;
  std::vector<std::int64_t> in_;  // elements from one index of an axis to the next
  std::vector<std::int64_t> out_;
};

class ReduceKernel : public LevelKernel<ReduceOp, ReduceRoutines> {
 public:
  using LevelKernel::LevelKernel;

  /// Sums in float64.
  [[nodiscard]] std::size_t scratch_bytes(const Op& op, std::span<const Shape> /*inputs*/,
                                          const Shape& output) const override {
    const bool mean = static_cast<const ReduceOp&>(op).kind() == ReduceKind::kMean;
    return mean ? static_cast<std::size_t>(output.count()) * sizeof(double) : 0;
  }

 private:
  /// A mean is rounded once, to float32; the float64 sum adds at most n · 2^-53 = n · 2^-29 · u.
  [[nodiscard]] double factor(const ReduceOp& op, std::span<const Shape> inputs) const override {
    if (op.kind() != ReduceKind::kMean) return 0;
    return rounding_factor(1) + static_cast<double>(inputs[0].count()) * 0x1p-29;
  }

  void compute(const ReduceOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> scratch) const override {
    const Shape& shape = inputs[0].shape();
    const std::vector<MergedAxis> axes = merged_axes(op, shape);
    float* y = f32(output);
    if (op.kind() == ReduceKind::kMean) {
      double* sums = static_cast<double*>(static_cast<void*>(scratch.data()));
      std::fill(sums, sums + output.count(), 0.0);
      Walk(axes, [&](const float* x, std::int64_t to, std::int64_t count, bool whole) {
        const auto n = static_cast<std::size_t>(count);
        if (whole)
          sums[to] += routines().sum(x, n);
        else
          routines().add_to(sums + to, x, n);
      }).run(f32(inputs[0]));
      const double count = static_cast<double>(shape.count()) / static_cast<double>(output.count());
      for (std::int64_t i = 0; i < output.count(); ++i) y[i] = static_cast<float>(sums[i] / count);
      return;
    }
    const bool largest = op.kind() == ReduceKind::kMax;
    const auto one = largest ? routines().maximum : routines().minimum;
    const auto into = largest ? routines().maximum_to : routines().minimum_to;
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    std::fill(y, y + output.count(), largest ? -kInfinity : kInfinity);
    Walk(axes, [&](const float* x, std::int64_t to, std::int64_t count, bool whole) {
      if (!whole) return into(y + to, x, static_cast<std::size_t>(count));
      const float best = one(x, static_cast<std::size_t>(count));
      into(y + to, &best, 1);
    }).run(f32(inputs[0]));
  }
};

}  // namespace

std::span<const Kernel* const> ReduceOp::kernels() const {
  static const KernelList<ReduceKernel, ReduceRoutines> list("reduce.rows", reduce_routines());
  return list.all();
}

}  // namespace slide::ops
