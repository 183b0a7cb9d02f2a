#include <algorithm>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/simd/dispatch.h"
#include "ops/softmax/softmax_op.h"
#include "ops/softmax/softmax_routines.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)      \
  namespace level {                           \
  extern const SoftmaxRoutines softmax_loops; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const SoftmaxRoutines* const> softmax_routines() {
#define SLIDE_LIST(level, enumerator) &level::softmax_loops,
  static constexpr const SoftmaxRoutines* kAll[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return kAll;
}

namespace {

class SoftmaxKernel : public LevelKernel<SoftmaxOp, SoftmaxRoutines> {
 public:
  using LevelKernel::LevelKernel;

 private:
  /// Relative to the result: 2 for the exponential (1 ULP), 2 for those in the sum, 1 for the rounded sum and
  /// 1 for the division; the differences' roundings are in the error scale. The float64 sum adds n · 2^-29.
  [[nodiscard]] double factor(const SoftmaxOp& op, std::span<const Shape> inputs) const override {
    return rounding_factor(6) + static_cast<double>(inputs[0][op.axis()]) * 0x1p-29;
  }
  void compute(const SoftmaxOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const AxisView view = axis_view(output.shape(), require_axis("softmax", op.axis(), output.shape()));
    const float* x = f32(inputs[0]);
    float* y = f32(output);
    const auto count = static_cast<std::size_t>(view.axis);
    if (view.inner == 1) {
      const std::int64_t rows_a_task = std::max<std::int64_t>(1, kElementGrain / 8 / view.axis);
      for_ranges(view.outer, rows_a_task, [&](std::int64_t begin, std::int64_t end) {
        for (std::int64_t i = begin; i < end; ++i)
          routines().row(x + i * view.axis, y + i * view.axis, count);
      });
      return;
    }
    constexpr auto kColumns = static_cast<std::int64_t>(SoftmaxRoutines::kColumns);
    const std::int64_t blocks = (view.inner + kColumns - 1) / kColumns;
    for_ranges(view.outer * blocks, 1, [&](std::int64_t task, std::int64_t) {
      const std::int64_t first = task % blocks * kColumns;
      const std::int64_t at = task / blocks * view.axis * view.inner + first;
      routines().columns(x + at, y + at, count, static_cast<std::size_t>(view.inner),
                         static_cast<std::size_t>(std::min(kColumns, view.inner - first)));
    });
  }
};

}  // namespace

std::span<const Kernel* const> SoftmaxOp::kernels() const {
  static const KernelList<SoftmaxKernel, SoftmaxRoutines> list("softmax.three_pass", softmax_routines());
  return list.all();
}

}  // namespace slide::ops
