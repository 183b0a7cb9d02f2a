#include "ops/attention/attention_strips.h"
#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/conv2d/conv2d_op.h"
#include "ops/simd/dispatch.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)    \
  namespace level {                         \
  extern const AttentionRoutines attention; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const AttentionRoutines* const> attention_routines() {
#define SLIDE_LIST(level, enumerator) &level::attention,
  static const AttentionRoutines* const all[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return all;
}

namespace {

class AttentionKernel : public LevelKernel<ContextualAttentionOp, AttentionRoutines> {
 public:
  using LevelKernel::LevelKernel;

  /// A patch's weight may round to zero, which times an infinite value is NaN.
  [[nodiscard]] Domain domain() const override { return {.reach = Reach::kImage}; }
  [[nodiscard]] std::size_t scratch_bytes(const Op& op, std::span<const Shape> inputs,
                                          const Shape& /*output*/) const override {
    return method(static_cast<const ContextualAttentionOp&>(op), inputs).scratch_bytes();
  }
  [[nodiscard]] double macs(const Op& op, std::span<const Shape> inputs,
                            const Shape& /*output*/) const override {
    return method(static_cast<const ContextualAttentionOp&>(op), inputs).macs();
  }

 private:
  [[nodiscard]] AttentionStrips method(const ContextualAttentionOp& op, std::span<const Shape> inputs) const {
    const Conv2dRoutines* conv = conv2d_routines().back();
    for (const Conv2dRoutines* routines : conv2d_routines())
      if (routines->isa == isa()) conv = routines;
    return {routines(), *conv, attention_geometry(inputs, op.params())};
  }
  [[nodiscard]] double factor(const ContextualAttentionOp& op, std::span<const Shape> inputs) const override {
    return method(op, inputs).error_factor();
  }
  void compute(const ContextualAttentionOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> scratch) const override {
    method(op, shapes_of(inputs))
        .run(f32(inputs[0]), f32(inputs[1]), f32(inputs[2]), inputs.size() > 3 ? f32(inputs[3]) : nullptr,
             f32(output), scratch);
  }
};

}  // namespace

std::span<const Kernel* const> ContextualAttentionOp::kernels() const {
  static const KernelList<AttentionKernel, AttentionRoutines> list("contextual_attention.strips",
                                                                   attention_routines());
  return list.all();
}

}  // namespace slide::ops
