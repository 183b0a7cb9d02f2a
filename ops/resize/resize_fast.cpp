#include <algorithm>
#include <limits>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/resize/resize_op.h"
#include "ops/resize/resize_routines.h"
#include "ops/resize/resized_rows.h"
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

const ResizeRoutines& resize_routines(Isa isa) {
  return **std::ranges::find_if(resize_routines(), [&](const auto* r) { return runs_at(r->isa, isa); });
}

namespace {

class ResizeKernel : public LevelKernel<ResizeOp, ResizeRoutines> {
 public:
  using LevelKernel::LevelKernel;
  [[nodiscard]] bool supports(const Op& /*op*/, std::span<const Shape> inputs,
                              const Shape& /*output*/) const override {
    return inputs[0][3] <= std::numeric_limits<std::int32_t>::max();
  }

 private:
  /// In each direction the weights are rounded, then the products, then taps - 1 sums. Nearest copies. A
  /// residual is one more rounding.
  [[nodiscard]] double factor(const ResizeOp& op, std::span<const Shape> /*inputs*/) const override {
    const int residual = op.fusion().residual ? 1 : 0;
    switch (op.params().mode) {
      case ResizeMode::kNearest:
        return rounding_factor(residual);
      case ResizeMode::kLinear:
        return rounding_factor(2 * 3 + residual);
      case ResizeMode::kCubic:
        return rounding_factor(2 * 5 + residual);
    }
    return 0;
  }

  void compute(const ResizeOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    resize_planes(routines(), op, nchw(inputs[0].shape()), f32(inputs[0]),
                  op.fusion().residual ? f32(inputs[1]) : nullptr, f32(output));
  }
};

}  // namespace

std::span<const Kernel* const> ResizeOp::kernels() const {
  static const KernelList<ResizeKernel, ResizeRoutines> list("resize.separable", resize_routines());
  return list.all();
}

}  // namespace slide::ops
