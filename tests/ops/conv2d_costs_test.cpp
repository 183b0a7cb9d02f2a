// What is known of the speed of convolutions on each processor, and what plans make of it.

#include "ops/conv2d/conv2d_expectation.h"

#include <doctest/doctest.h>

#include "kernel_bounds.h"
#include "ops/conv2d/conv2d.h"
#include "runtime/plan.h"

using namespace slide;

namespace {

constexpr CpuFeatures kNone;

/// The kernel of a plan of one convolution, 1x1.
const Kernel& chosen(Isa isa, Precision precision, bool only) {
  Graph graph;
  const Value x = graph.input("x", {1, 48, 24, 40});
  const Value w = graph.parameter("w", {48, 48, 1, 1});
  graph.output("y", ops::conv2d(x, w, std::nullopt, {}));
  const Plan plan = make_plan(graph, {.isa = isa, .precision = precision, .only_precision = only});
  REQUIRE(plan.steps.size() == 1);
  return *plan.steps[0].kernel;
}

}  // namespace

TEST_CASE("a processor's costs are those of its vendor and features, an unknown one's the last row's") {
  const CpuFeatures avx512 = kNone.with(CpuFeature::kAvx512);
  const ops::Conv2dCosts& intel = ops::conv2d_costs("GenuineIntel", avx512);
  const ops::Conv2dCosts& amd = ops::conv2d_costs("AuthenticAMD", avx512);
  CHECK(intel.vendor == "GenuineIntel");
  CHECK(amd.vendor == "AuthenticAMD");
  CHECK(ops::conv2d_costs("", kNone).vendor.empty());
  CHECK(ops::conv2d_costs("GenuineIntel", kNone).vendor.empty());
  // bfloat16 in vectors: half the rate of float32 on one, twice it on the other.
  CHECK(ops::conv2d_speed(intel, "conv2d.direct_bf16", Isa::kAvx512Bf16) < 1);
  CHECK(ops::conv2d_speed(amd, "conv2d.direct_bf16", Isa::kAvx512Bf16) > 1);
  CHECK(ops::conv2d_speed(intel, "conv2d.direct_bf16", Isa::kAmx) > 2);
}

TEST_CASE("a layer is computed in a lower precision where that is not predicted to be slower") {
  const auto speed = [](const Kernel& k) {
    return ops::conv2d_speed(ops::conv2d_costs(), k.name(), k.isa());
  };
  for (const Isa isa : available_isas())
    for (const Precision precision : {Precision::kBf16, Precision::kInt8}) {
      INFO(std::string(name_of(isa)), " ", std::string(name_of(precision)));
      const Kernel& low = chosen(isa, precision, true);
      const Kernel& exact = chosen(isa, Precision::kFp32, false);
      CHECK(low.precision() == precision);
      CHECK(exact.precision() == Precision::kFp32);
      CHECK(&chosen(isa, precision, false) == (speed(low) < speed(exact) ? &exact : &low));
    }
  // There the products of 8-bit integers are emulated.
  CHECK(chosen(Isa::kBaseline, Precision::kInt8, false).precision() == Precision::kFp32);
}
