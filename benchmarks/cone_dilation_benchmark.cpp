// Dilation by a cone on a 672×1008 disparity map: the kernel, whose time does not depend on the radius,
// against the plain form that looks at every pixel of the window, O(n·m), written as a loop over shifted rows
// and columns that compilers vectorise.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "ops/layering/layering_ops.h"
#include "runtime/threads.h"

namespace {

using namespace slide;

constexpr std::int64_t kHeight = 672;
constexpr std::int64_t kWidth = 1008;

Tensor disparity() {
  std::mt19937 generator(1);
  Tensor x(DType::kF32, {1, 1, kHeight, kWidth});
  for (float& v : x.mutable_data<float>()) v = static_cast<float>(generator() >> 8) * 0x1p-24F;
  return x;
}

/// Joins to[j] with from[j] - fall for count pixels.
void join(const float* from, float fall, float* to, std::int64_t count) {
  for (std::int64_t j = 0; j < count; ++j) to[j] = std::max(to[j], from[j] - fall);
}

void plain(const float* x, float rho, std::int64_t radius, float* y) {
  parallel_for(kHeight, [&](std::int64_t i) {
    float* to = y + i * kWidth;
    std::copy(x + i * kWidth, x + (i + 1) * kWidth, to);
    for (std::int64_t k = 1; k <= radius; ++k) {
      const float fall = rho * static_cast<float>(k);
      if (i >= k) join(x + (i - k) * kWidth, fall, to, kWidth);
      if (i + k < kHeight) join(x + (i + k) * kWidth, fall, to, kWidth);
      if (k >= kWidth) continue;
      join(x + i * kWidth, fall, to + k, kWidth - k);
      join(x + i * kWidth + k, fall, to, kWidth - k);
    }
  });
}

void report(benchmark::State& state) {
  state.SetItemsProcessed(state.iterations() * kHeight * kWidth);
  state.SetLabel(std::to_string(thread_count()) + " threads");
}

void plain_form(benchmark::State& state) {
  const Tensor x = disparity();
  Tensor y(DType::kF32, x.shape());
  const std::int64_t radius = state.range(0);
  for (auto _ : state)
    plain(x.data<float>().data(), 1 / static_cast<float>(radius), radius, y.mutable_data<float>().data());
  report(state);
}

void kernel(benchmark::State& state) {
  const ops::ConeDilationOp op(1 / static_cast<double>(state.range(0)), state.range(0));
  const Tensor x = disparity();
  Tensor y(DType::kF32, x.shape());
  const auto kernels = op.kernels();
  const auto chosen = std::ranges::find_if(kernels, [](const Kernel* k) { return k->isa() == active_isa(); });
  for (auto _ : state) (*chosen)->run(op, std::span<const Tensor>(&x, 1), y, {});
  report(state);
}

}  // namespace

BENCHMARK(plain_form)->RangeMultiplier(2)->Range(8, 512)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(kernel)->RangeMultiplier(2)->Range(8, 512)->UseRealTime()->Unit(benchmark::kMillisecond);
