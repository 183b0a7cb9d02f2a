#include <vector>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/conv2d/conv2d_depthwise.h"
#include "ops/conv2d/conv2d_gemm.h"
#include "ops/conv2d/conv2d_op.h"
#include "ops/simd/dispatch.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)       \
  namespace level {                            \
  extern const Conv2dRoutines conv2d_routines; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const Conv2dRoutines* const> conv2d_routines() {
#define SLIDE_LIST(level, enumerator) &level::conv2d_routines,
  static const Conv2dRoutines* const all[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return all;
}

namespace {

/// Conv2dGemm or Conv2dDepthwise with the routines of one level.
template <typename Method>
class Conv2dKernel : public LevelKernel<Conv2dOp, Conv2dRoutines> {
 public:
  using LevelKernel::LevelKernel;

  [[nodiscard]] bool supports(const Op& op, std::span<const Shape> inputs,
                              const Shape& /*output*/) const override {
    return Method::fits(geometry(op, inputs));
  }
  [[nodiscard]] std::size_t scratch_bytes(const Op& op, std::span<const Shape> inputs,
                                          const Shape& /*output*/) const override {
    return Method(routines(), geometry(op, inputs)).scratch_bytes();
  }

 private:
  [[nodiscard]] static Conv2dGeometry geometry(const Op& op, std::span<const Shape> inputs) {
    return conv2d_geometry(op.type(), inputs, static_cast<const Conv2dOp&>(op).params());
  }
  [[nodiscard]] double factor(const Conv2dOp& op, std::span<const Shape> inputs) const override {
    return Method(routines(), geometry(op, inputs)).error_factor();
  }
  void compute(const Conv2dOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> scratch) const override {
    const float* bias = inputs.size() > 2 ? f32(inputs[2]) : nullptr;
    Method(routines(), geometry(op, shapes_of(inputs)))
        .run(f32(inputs[0]), f32(inputs[1]), bias, f32(output), scratch);
  }
};

}  // namespace

std::span<const Kernel* const> Conv2dOp::kernels() const {
  static const std::vector<const Kernel*> all = [] {
    static const KernelList<Conv2dKernel<Conv2dDepthwise>, Conv2dRoutines> depthwise("conv2d.depthwise",
                                                                                     conv2d_routines());
    static const KernelList<Conv2dKernel<Conv2dGemm>, Conv2dRoutines> gemm("conv2d.gemm", conv2d_routines());
    std::vector<const Kernel*> both(depthwise.all().begin(), depthwise.all().end());
    both.insert(both.end(), gemm.all().begin(), gemm.all().end());
    return both;
  }();
  return all;
}

}  // namespace slide::ops
