// With one group the gate is applied to each tile of the convolution's matrix product as it is finished. With
// more, features and gates lie in different groups: the whole convolution first, then the gate.

#include <algorithm>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/conv2d/conv2d_gemm.h"
#include "ops/conv2d/conv2d_op.h"
#include "ops/gated_conv/gated_conv2d_op.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

class GatedConv2dKernel : public LevelKernel<GatedConv2dOp, Conv2dRoutines> {
 public:
  using LevelKernel::LevelKernel;

  [[nodiscard]] std::size_t scratch_bytes(const Op& op, std::span<const Shape> inputs,
                                          const Shape& /*output*/) const override {
    const Conv2dGeometry g = static_cast<const GatedConv2dOp&>(op).geometry(inputs);
    return convolution_bytes(g) + method(g).scratch_bytes();
  }

 private:
  [[nodiscard]] Conv2dGemm method(const Conv2dGeometry& g) const { return {routines(), g, g.groups == 1}; }

  /// Of the convolution's result, if it is stored.
  [[nodiscard]] static std::size_t convolution_bytes(const Conv2dGeometry& g) {
    if (g.groups == 1) return 0;
    const std::int64_t count = g.output().count() + kRowAlignment;  // the gate reads whole vectors
    return static_cast<std::size_t>((count + kRowAlignment - 1) / kRowAlignment * kRowAlignment) *
           sizeof(float);
  }

  /// The convolution's factor for what reaches y from it, and for elu (1 ULP, 2u), sigmoid (2.5 ULP, 5u) and
  /// their product (u) 8 times |y|, which the scale holds as a term of its own.
  [[nodiscard]] double factor(const GatedConv2dOp& op, std::span<const Shape> inputs) const override {
    return 1.01 * std::max(method(op.geometry(inputs)).error_factor(), 8.0);
  }

  void compute(const GatedConv2dOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> scratch) const override {
    const Conv2dGeometry g = op.geometry(shapes_of(inputs));
    const float* bias = inputs.size() > 2 ? f32(inputs[2]) : nullptr;
    const std::span<std::byte> rest = scratch.subspan(convolution_bytes(g));
    if (g.groups == 1) return method(g).run(f32(inputs[0]), f32(inputs[1]), bias, f32(output), rest);
    auto* conv = static_cast<float*>(static_cast<void*>(scratch.data()));
    method(g).run(f32(inputs[0]), f32(inputs[1]), bias, conv, rest);
    const std::int64_t half = g.oc / 2;
    float* y = f32(output);
    parallel_for(g.batch * half, [&](std::int64_t plane) {
      const float* a = conv + (plane / half * g.oc + plane % half) * g.oplane();
      routines().gate(a, a + half * g.oplane(), y + plane * g.oplane(), g.oplane());
    });
  }
};

}  // namespace

std::span<const Kernel* const> GatedConv2dOp::kernels() const {
  static const KernelList<GatedConv2dKernel, Conv2dRoutines> list("gated_conv2d.gemm", conv2d_routines());
  return list.all();
}

}  // namespace slide::ops
