#include "ops/conv2d/conv2d_expectation.h"

#include <algorithm>
#include <iterator>
#include <string>

#include "runtime/cpu_vendor.h"
#include "runtime/error.h"

namespace slide::ops {
namespace {

// Measured on 15 layers of 16 to 512 channels, 1×1 to 5×5, strides 1 and 2, dilations 1 to 4, with and
// without a gate, of normally distributed inputs (ten of them rectified), weights and biases: the error
// against float64, the larger of what rectified and symmetric inputs give where they differ (8-bit integers:
// 0.009 and 0.0125, for ranges of 4.5 to 8 times the root mean square), the speed with one thread on a Zen 5
// as the median (of bfloat16 and integers at avx512bf16 on four of the layers; of F(4) and F(2) of bfloat16
// by the times of U²-Net's and MiDaS small's layers beside those of other methods). Depthwise and grouped
// layers have no other method of their level that computes as much. bfloat16 is emulated below avx512bf16,
// integers are at baseline and neon; with VNNI they are taken to gain as much at each level. Of avx2 and avx512
// without it: on an Intel Xeon, 2026-11-29, where weights are uniform, which takes the most entries of split
// pairs. neon, which was not measured, is taken to be like baseline, its levels of lower precision by
// instructions for each product (docs/benchmarks.md), less what loads and stores leave of that.
constexpr Conv2dExpectation kExpectations[] = {
    {"conv2d.depthwise", 0.35, {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1}},
    {"conv2d.few_filters", 0.32, {1, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1, 1, 1, 1}},
    {"conv2d.winograd4", 1.5, {0.75, 0.75, 0.75, 0.65, 0.65, 0.65, 0.65, 0.75, 0.75, 0.75, 0.75}},
    {"conv2d.winograd2", 0.6, {0.75, 0.75, 0.75, 0.72, 0.72, 0.72, 0.72, 0.75, 0.75, 0.75, 0.75}},
    {"conv2d.grouped_gate", 0.35, {0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9}},
    {"conv2d.direct", 0.3, {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1}},
    {"conv2d.gemm", 0.31, {0.85, 0.85, 0.85, 0.85, 0.85, 0.85, 0.85, 0.85, 0.85, 0.85, 0.85}},
    {"conv2d.winograd4_bf16", 1.17e-2, {0.7, 0.6, 0.6, 0.68, 0.68, 1.05, 1.05, 0.7, 0.7, 0.7, 0.7}},
    {"conv2d.winograd2_bf16", 4.2e-3, {0.7, 0.6, 0.6, 0.68, 0.68, 1.1, 1.1, 0.7, 0.7, 0.7, 0.7}},
    {"conv2d.direct_bf16", 2.4e-3, {0.78, 0.75, 0.75, 1, 1, 1.9, 3.4, 0.78, 0.78, 0.78, 1.9}},
    {"conv2d.direct_int8", 1.2e-2, {0.3, 1.2, 3.6, 1.1, 3.6, 3.6, 4.2, 0.3, 3, 3.6, 3.6}},
    {"conv2d.winograd6", 2.5, {0.75, 0.6, 0.6, 0.5, 0.5, 0.5, 0.5, 0.75, 0.75, 0.75, 0.75}},
};

// Intel's vectors multiply bfloat16 at half the rate of float32, its tiles at seven times that. Measured with
// one thread as GFLOP of all layers by a method in MiDaS small, U²-Net's small version and the coarse
// inpainting, beside the direct float32 layers' 124. Winograd's F(4) is as fast in both precisions; then the
// more exact one is to be chosen.
constexpr Conv2dSpeed kIntelSpeeds[] = {
    {"conv2d.winograd4", Isa::kAvx512Bf16, 0.58},
    {"conv2d.winograd2", Isa::kAvx512Bf16, 0.51},
    {"conv2d.winograd4_bf16", Isa::kAvx512Bf16, 0.57},
    {"conv2d.winograd2_bf16", Isa::kAvx512Bf16, 0.62},
    {"conv2d.direct_bf16", Isa::kAvx512Bf16, 0.72},
    {"conv2d.direct_int8", Isa::kAvx512Bf16, 3.3},
    {"conv2d.direct_bf16", Isa::kAmx, 3.4},
    {"conv2d.direct_int8", Isa::kAmx, 4.2},
};

constexpr Conv2dCosts kCosts[] = {
    {"Intel Xeon with AMX, 2026-11-29", "GenuineIntel", CpuFeatures().with(CpuFeature::kAvx512),
     kIntelSpeeds},
    {"AMD Zen 5, 2026-11-23", "AuthenticAMD", CpuFeatures().with(CpuFeature::kAvx512), {}},
    {"AArch64, by instructions counted, 2026-11-29", "", CpuFeatures().with(CpuFeature::kNeon), {}},
    {"AMD Zen 5, 2026-11-23, taken for others", "", CpuFeatures(), {}},
};

}  // namespace

const Conv2dExpectation& conv2d_expectation(std::string_view kernel) {
  const auto* const it = std::find_if(std::begin(kExpectations), std::end(kExpectations),
                                      [&](const Conv2dExpectation& e) { return e.kernel == kernel; });
  if (it == std::end(kExpectations))
    throw Error(ErrorKind::kInternal, "nothing is known of the speed and error of " + std::string(kernel));
  return *it;
}

const Conv2dCosts& conv2d_costs(std::string_view vendor, CpuFeatures features) {
  return *std::ranges::find_if(kCosts, [&](const Conv2dCosts& row) {
    return (row.vendor.empty() || row.vendor == vendor) && features.includes(row.features);
  });
}

const Conv2dCosts& conv2d_costs() {
  static const Conv2dCosts& row = conv2d_costs(cpu_vendor(), detected_features());
  return row;
}

double conv2d_speed(const Conv2dCosts& costs, std::string_view kernel, Isa isa) {
  for (const Conv2dSpeed& own : costs.speeds)
    if (own.kernel == kernel && own.isa == isa) return own.speed;
  return conv2d_expectation(kernel).speed[static_cast<int>(isa)];
}

}  // namespace slide::ops
