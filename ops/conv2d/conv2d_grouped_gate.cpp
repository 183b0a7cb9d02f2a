#include "ops/conv2d/conv2d_grouped_gate.h"

#include "runtime/threads.h"

namespace slide::ops {
namespace {

Conv2dFusion before_the_gate(const Conv2dFusion& fusion) {
  Conv2dFusion before;
  before.relu_input = fusion.relu_input;
  return before;
}

}  // namespace

Conv2dGroupedGate::Conv2dGroupedGate(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                                     const Conv2dFusion& fusion)
    : routines_(routines),
      g_(geometry),
      convolution_(routines, geometry, before_the_gate(fusion)),
      epilogue_(fusion, routines.isa) {}

std::size_t Conv2dGroupedGate::result_bytes() const noexcept {
  const std::int64_t count = g_.output().count() + kRowAlignment;  // the gate reads whole vectors
  return static_cast<std::size_t>((count + kRowAlignment - 1) / kRowAlignment * kRowAlignment) *
         sizeof(float);
}

std::size_t Conv2dGroupedGate::scratch_bytes() const noexcept {
  return result_bytes() + convolution_.scratch_bytes();
}

void Conv2dGroupedGate::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
  auto* conv = static_cast<float*>(static_cast<void*>(scratch.data()));
  convolution_.run({arrays.x, arrays.packed, arrays.bias, nullptr, conv}, scratch.subspan(result_bytes()));
  const std::int64_t half = g_.oc / 2;
  parallel_for(g_.batch * half, [&](std::int64_t plane) {
    const float* a = conv + (plane / half * g_.oc + plane % half) * g_.oplane();
    float* y = arrays.y + plane * g_.oplane();
    routines_.gate(a, a + half * g_.oplane(), y, g_.oplane());
    if (epilogue_.empty(arrays.residual)) return;
    epilogue_.finish(y, arrays.residual != nullptr ? arrays.residual + plane * g_.oplane() : nullptr, y,
                     g_.oplane());
  });
}

}  // namespace slide::ops
