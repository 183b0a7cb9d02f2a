#include <algorithm>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/normalise/layer_norm_routines.h"
#include "ops/normalise/normalise_ops.h"
#include "ops/simd/dispatch.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)           \
  namespace level {                                \
  extern const LayerNormRoutines layer_norm_loops; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const LayerNormRoutines* const> layer_norm_routines() {
#define SLIDE_LIST(level, enumerator) &level::layer_norm_loops,
  static constexpr const LayerNormRoutines* kAll[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return kAll;
}

namespace {

class LayerNormKernel : public LevelKernel<LayerNormOp, LayerNormRoutines> {
 public:
  using LevelKernel::LevelKernel;

 private:
  /// The difference, the rounded 1 / sqrt(), its product with the rest of the mean, and the result: the
  /// baseline rounds products and sums apart.
  [[nodiscard]] double factor(const LayerNormOp& /*op*/, std::span<const Shape> /*inputs*/) const override {
    return rounding_factor(6);
  }
  void compute(const LayerNormOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const AxisView view = axis_view(output.shape(), require_axis("layer_norm", op.axis(), output.shape()));
    const float* x = f32(inputs[0]);
    float* y = f32(output);
    const auto lines = [&](std::int64_t at) {
      return LayerNormLines{x + at, f32(inputs[1]), f32(inputs[2]), op.eps(), view.axis, view.inner};
    };
    if (view.inner == 1) {
      const std::int64_t rows_a_task = std::max<std::int64_t>(1, kElementGrain / 8 / view.axis);
      for_ranges(view.outer, rows_a_task, [&](std::int64_t begin, std::int64_t end) {
        for (std::int64_t i = begin; i < end; ++i) routines().row(lines(i * view.axis), y + i * view.axis);
      });
      return;
    }
    constexpr std::int64_t kColumns = LayerNormRoutines::kColumns;
    const std::int64_t blocks = (view.inner + kColumns - 1) / kColumns;
    for_ranges(view.outer * blocks, 1, [&](std::int64_t task, std::int64_t) {
      const std::int64_t first = task % blocks * kColumns;
      const std::int64_t at = task / blocks * view.axis * view.inner + first;
      routines().columns(lines(at), y + at, std::min(kColumns, view.inner - first));
    });
  }
};

}  // namespace

std::span<const Kernel* const> LayerNormOp::kernels() const {
  static const KernelList<LayerNormKernel, LayerNormRoutines> list("layer_norm.float64_sums",
                                                                   layer_norm_routines());
  return list.all();
}

}  // namespace slide::ops
