// Windows are separable: the rows of a window are joined first, in a row buffer with the padding at both
// ends, then its columns. Means over large windows (adaptive and global) are summed in float64.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/pool/pool_op.h"
#include "ops/pool/pool_routines.h"
#include "ops/reduce/reduce_routines.h"
#include "ops/simd/dispatch.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator) \
  namespace level {                      \
  extern const PoolRoutines pooling;     \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const PoolRoutines* const> pool_routines() {
#define SLIDE_LIST(level, enumerator) &level::pooling,
  static constexpr const PoolRoutines* kAll[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return kAll;
}

namespace {

constexpr std::int64_t kRowsPerTask = 16;

/// Whether it is the maximum of 2×2 at stride 2 without padding.
bool takes_pairs(const PoolOp& op) {
  constexpr std::array<std::int64_t, 2> kTwo = {2, 2};
  const PoolParams& p = op.params();
  return op.kind() == PoolKind::kMax && p.kernel == kTwo && p.stride == kTwo &&
         p.padding == std::array<std::int64_t, 4>{};
}

class PoolKernel : public LevelKernel<PoolOp, PoolRoutines> {
 public:
  PoolKernel(std::string_view name, const PoolRoutines& routines)
      : LevelKernel(name, routines),
        reduce_(**std::ranges::find_if(reduce_routines(),
                                       [&](const ReduceRoutines* r) { return r->isa == routines.isa; })) {}

 private:
  /// A mean over kh × kw elements takes kh - 1 additions along columns, kw - 1 along rows, the rounding of a
  /// very large divisor, and the division. Zeros of the padding cost nothing.
  [[nodiscard]] double factor(const PoolOp& op, std::span<const Shape> inputs) const override {
    if (op.kind() == PoolKind::kMax) return 0;
    const auto& kernel = op.params().kernel;
    return rounding_factor(
        static_cast<double>(std::min(kernel[0], inputs[0][2]) + std::min(kernel[1], inputs[0][3])));
  }

  void compute(const PoolOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const Nchw in = nchw(inputs[0].shape());
    const Nchw out = nchw(output.shape());
    const std::int64_t tasks = (out.h + kRowsPerTask - 1) / kRowsPerTask;
    for_ranges(in.n * in.c * tasks, 1, [&](std::int64_t task, std::int64_t) {
      const std::int64_t plane = task / tasks;
      const std::int64_t first = task % tasks * kRowsPerTask;
      pool_rows(op, in, out, f32(inputs[0]) + plane * in.plane(), f32(output) + plane * out.plane(), first,
                std::min(out.h, first + kRowsPerTask));
    });
  }

  void halve_rows(const PoolOp& op, const Nchw& in, const Nchw& out, const float* x, float* y,
                  std::int64_t first, std::int64_t last) const {
    const auto width = static_cast<std::size_t>(std::min(in.w, 2 * out.w));
    for (std::int64_t i = first; i < last; ++i) {
      const PoolWindow rows = op.window(0, i, in.h);
      routines().maxima_of_pairs(x + rows.begin * in.w, x + (rows.end - 1) * in.w, width, y + i * out.w);
    }
  }

  void pool_rows(const PoolOp& op, const Nchw& in, const Nchw& out, const float* x, float* y,
                 std::int64_t first, std::int64_t last) const {
    if (takes_pairs(op)) return halve_rows(op, in, out, x, y, first, last);
    const PoolParams& p = op.params();
    const bool max = op.kind() == PoolKind::kMax;
    const std::int64_t left = p.padding[1];
    const auto width = static_cast<std::size_t>(in.w);
    const std::int64_t buffer_width = std::max(left + in.w, (out.w - 1) * p.stride[1] + p.kernel[1]);
    std::vector<float> row(static_cast<std::size_t>(buffer_width),
                           max ? -std::numeric_limits<float>::infinity() : 0.0F);
    std::vector<float> divisors(static_cast<std::size_t>(max ? 0 : out.w));
    for (std::int64_t j = 0; j < std::ssize(divisors); ++j)
      divisors[static_cast<std::size_t>(j)] = static_cast<float>(op.divisor(1, j, in.w));
    float* middle = row.data() + left;
    for (std::int64_t i = first; i < last; ++i) {
      const PoolWindow rows = op.window(0, i, in.h);
      std::copy(x + rows.begin * in.w, x + (rows.begin + 1) * in.w, middle);
      for (std::int64_t r = rows.begin + 1; r < rows.end; ++r)
        (max ? reduce_.maximum_to : routines().add_to)(middle, x + r * in.w, width);
      float* to = y + i * out.w;
      (max ? routines().maxima : routines().sums)(row.data(), static_cast<std::size_t>(p.kernel[1]),
                                                  static_cast<std::size_t>(p.stride[1]), to,
                                                  static_cast<std::size_t>(out.w));
      if (max) continue;
      const float divisor = static_cast<float>(op.divisor(0, i, in.h));
      for (std::int64_t j = 0; j < out.w; ++j) {
        to[j] /= divisor * divisors[static_cast<std::size_t>(j)];
        if (!std::isfinite(to[j])) to[j] = wide_mean(op, in, x, i, j);
      }
    }
  }

  /// A mean whose sum float32 does not hold, or of numbers that are not finite.
  static float wide_mean(const PoolOp& op, const Nchw& in, const float* x, std::int64_t i, std::int64_t j) {
    const PoolWindow rows = op.window(0, i, in.h);
    const PoolWindow columns = op.window(1, j, in.w);
    double sum = 0;
    for (std::int64_t r = rows.begin; r < rows.end; ++r)
      for (std::int64_t c = columns.begin; c < columns.end; ++c) sum += static_cast<double>(x[r * in.w + c]);
    return static_cast<float>(sum / static_cast<double>(op.divisor(0, i, in.h) * op.divisor(1, j, in.w)));
  }

  const ReduceRoutines& reduce_;
};

class AdaptiveAvgPoolKernel : public LevelKernel<AdaptiveAvgPoolOp, ReduceRoutines> {
 public:
  using LevelKernel::LevelKernel;

 private:
  /// One rounding to float32; the float64 sums of n elements add n · 2^-53 = n · 2^-29 · u.
  [[nodiscard]] double factor(const AdaptiveAvgPoolOp& /*op*/, std::span<const Shape> inputs) const override {
    return rounding_factor(1) + static_cast<double>(inputs[0][2] * inputs[0][3]) * 0x1p-29;
  }

  void compute(const AdaptiveAvgPoolOp& /*op*/, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const Nchw in = nchw(inputs[0].shape());
    const Nchw out = nchw(output.shape());
    for_ranges(in.n * in.c * out.h, 1, [&](std::int64_t line, std::int64_t) {
      const float* x = f32(inputs[0]) + line / out.h * in.plane();
      float* y = f32(output) + line * out.w;
      const PoolWindow rows = AdaptiveAvgPoolOp::window(line % out.h, out.h, in.h);
      std::vector<double> sums(static_cast<std::size_t>(in.w), 0.0);
      for (std::int64_t r = rows.begin; r < rows.end; ++r)
        routines().add_to(sums.data(), x + r * in.w, static_cast<std::size_t>(in.w));
      for (std::int64_t j = 0; j < out.w; ++j) {
        const PoolWindow columns = AdaptiveAvgPoolOp::window(j, out.w, in.w);
        double sum = 0;
        for (std::int64_t c = columns.begin; c < columns.end; ++c) sum += sums[static_cast<std::size_t>(c)];
        const std::int64_t count = (rows.end - rows.begin) * (columns.end - columns.begin);
        y[j] = static_cast<float>(sum / static_cast<double>(count));
      }
    });
  }
};

}  // namespace

std::span<const Kernel* const> PoolOp::kernels() const {
  static const KernelList<PoolKernel, PoolRoutines> list("pool.separable", pool_routines());
  return list.all();
}

std::span<const Kernel* const> AdaptiveAvgPoolOp::kernels() const {
  static const KernelList<AdaptiveAvgPoolKernel, ReduceRoutines> list("adaptive_avg_pool2d.float64",
                                                                      reduce_routines());
  return list.all();
}

}  // namespace slide::ops
