// Columns are copied into interleaved lines as they lie, rows transposed; rows first, then columns join their
// maxima with what the rows gave. See cone_kernels.cpp for the algorithm.

#include <algorithm>
#include <cmath>
#include <vector>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/layering/layering_ops.h"
#include "ops/layering/layering_routines.h"

namespace slide::ops {
namespace {

/// Larger of two, NaN if either is.
float larger(float a, float b) { return std::isnan(a) || a > b ? a : b; }

/// Lines that are dilated together: line l holds the elements from + l·line_step + i·step, i < length.
struct Lines {
  std::int64_t count;
  std::int64_t line_step;
  std::int64_t step;
  std::int64_t length;
};

class ConeDilationKernel : public LevelKernel<ConeDilationOp, LayeringRoutines> {
 public:
  using LevelKernel::LevelKernel;

 private:
  /// Relative to M = max|x| over the window. rho·K <= 2·M for every candidate that matters, as it must beat
  /// x(p) itself. The best candidate may lose 1 in the comparison that passes it over, and the winner's value
  /// is rounded, 1; where the operation is not fused, 2 more on both occasions for the product; and 2 for the
  /// rounding of rho.
  [[nodiscard]] double factor(const ConeDilationOp& op, std::span<const Shape> /*inputs*/) const override {
    const bool exact_rho = static_cast<double>(static_cast<float>(op.rho())) == op.rho();
    return rounding_factor((routines().fused ? 2 : 6) + (exact_rho ? 0 : 2));
  }

  void compute(const ConeDilationOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const Nchw in = nchw(output.shape());
    const float* x = f32(inputs[0]);
    float* y = f32(output);
    const auto lanes = static_cast<std::int64_t>(routines().cone_lanes);
    const auto for_lines = [&](std::int64_t count, std::int64_t line_step, std::int64_t step,
                               std::int64_t length, bool join) {
      const std::int64_t groups = (count + lanes - 1) / lanes;
      for_ranges(in.n * in.c * groups, 1, [&](std::int64_t task, std::int64_t) {
        const std::int64_t first = task % groups * lanes;
        const std::int64_t at = task / groups * in.plane() + first * line_step;
        dilate(op, x + at, y + at, {std::min(lanes, count - first), line_step, step, length}, join);
      });
    };
    for_lines(in.h, in.w, 1, in.w, false);
    for_lines(in.w, 1, in.w, in.h, true);
  }

  /// Dilates the lines; the results replace what is in y, or are joined with it. Lanes beyond the last line
  /// repeat it.
  void dilate(const ConeDilationOp& op, const float* x, float* y, const Lines& lines, bool join) const {
    const std::size_t lanes = routines().cone_lanes;
    const auto length = static_cast<std::size_t>(lines.length);
    const auto radius = static_cast<std::size_t>(std::min(op.radius(), lines.length - 1));
    std::vector<float> memory(2 * length * lanes + cone_scratch(radius, lanes));
    float* const source = memory.data();
    float* const result = source + length * lanes;
    gather(x, lines, static_cast<std::int64_t>(lanes), source);
    routines().cone_lines(source, length, radius, static_cast<float>(op.rho()), result,
                          result + length * lanes);
    for (std::int64_t i = 0; i < lines.length; ++i) {
      const float* from = result + i * static_cast<std::int64_t>(lanes);
      float* to = y + i * lines.step;
      for (std::int64_t l = 0; l < lines.count; ++l)
        to[l * lines.line_step] = join ? larger(from[l], to[l * lines.line_step]) : from[l];
    }
  }

  static void gather(const float* x, const Lines& lines, std::int64_t lanes, float* source) {
    for (std::int64_t i = 0; i < lines.length; ++i) {
      const float* from = x + i * lines.step;
      float* to = source + i * lanes;
      if (lines.line_step == 1)
        std::copy(from, from + lines.count, to);
      else
        for (std::int64_t l = 0; l < lines.count; ++l) to[l] = from[l * lines.line_step];
      std::fill(to + lines.count, to + lanes, to[lines.count - 1]);
    }
  }
};

}  // namespace

std::span<const Kernel* const> ConeDilationOp::kernels() const {
  static const KernelList<ConeDilationKernel, LayeringRoutines> list("cone_dilation.van_herk",
                                                                     layering_routines());
  return list.all();
}

}  // namespace slide::ops
