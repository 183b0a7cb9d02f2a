#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <string_view>

#include "ops/check.h"
#include "ops/conv2d/conv2d_op.h"
#include "runtime/cpu.h"

using namespace slide;

namespace {

/// The nearest number of eight significant bits, of two the one whose last bit is zero; for 1 <= v < 2.
double nearest(double v) { return std::nearbyint(v * 128) / 128; }

/// 1 + i/512: quarters of the last of eight bits.
double quarter(std::int64_t i) { return 1 + static_cast<double>(i) / 512; }

}  // namespace

// Of 32 channels only the first is not zero, so that each result is one product, exact in float32.
TEST_CASE("bfloat16 has weights and inputs rounded to the nearest, ties to even") {
  constexpr std::int64_t kFilters = 64;
  constexpr std::int64_t kPixels = 64;
  const ops::Conv2dOp op{ops::Conv2dParams{}};
  Tensor x = Tensor::zeros(DType::kF32, {1, 32, 8, 8});
  Tensor weight = Tensor::zeros(DType::kF32, {kFilters, 32, 1, 1});
  for (std::int64_t i = 0; i < kPixels; ++i)
    x.mutable_data<float>()[static_cast<std::size_t>(i)] = static_cast<float>(quarter(i));
  for (std::int64_t o = 0; o < kFilters; ++o)
    weight.mutable_data<float>()[static_cast<std::size_t>(32 * o)] = static_cast<float>(quarter(o));
  const Tensor inputs[] = {x, weight};
  const ops::KernelTask task = ops::make_task(op, inputs);
  const Shape shapes[] = {x.shape(), weight.shape()};
  int kernels = 0;
  for (const Kernel* kernel : op.kernels()) {
    if (kernel->name() != "conv2d.direct_bf16" || !runs_at(kernel->isa(), detected_isa()) ||
        !kernel->supports(op, shapes, task.reference.shape()))
      continue;
    const std::string_view level = name_of(kernel->isa());
    CAPTURE(level);
    ++kernels;
    const ops::KernelCheck check = ops::check_kernel(*kernel, task);
    REQUIRE(check.problem.empty());
    int wrong = 0;
    for (std::int64_t o = 0; o < kFilters; ++o)
      for (std::int64_t i = 0; i < kPixels; ++i) {
        const auto at = static_cast<std::size_t>(o * kPixels + i);
        const double y = static_cast<double>(std::as_const(check.output).data<float>()[at]);
        wrong += y == nearest(quarter(o)) * nearest(quarter(i)) ? 0 : 1;
      }
    CHECK(wrong == 0);
  }
  CHECK(kernels >= 1);
}
