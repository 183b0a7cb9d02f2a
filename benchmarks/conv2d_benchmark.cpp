// Convolutions as the networks have them, through the fast executor: arithmetic of the definition per second.
// The arithmetic is that of the definition, whatever the method saves.

#include <benchmark/benchmark.h>

#include <string>

#include "graphs/formula_weights.h"
#include "ops/conv2d/conv2d.h"
#include "ops/conv2d/gated_conv2d.h"
#include "runtime/fast_executor.h"
#include "runtime/threads.h"

namespace {

using namespace slide;

/// One layer: channels in, filters, kernel, side of the image, stride, groups, gated.
struct Layer {
  std::int64_t ic, filters, kernel, side, stride, groups;
  bool gated;
};

void layer(benchmark::State& state, const Layer& l, Precision precision = Precision::kFp32) {
  Graph g;
  const Value x = g.input("x", {1, l.ic, l.side, l.side});
  const Value weight = g.parameter("weight", {l.filters, l.ic / l.groups, l.kernel, l.kernel});
  const Value bias = g.parameter("bias", {l.filters});
  const ops::Conv2dParams params = ops::Conv2dParams::same(l.kernel, l.stride, 1, l.groups);
  g.output("y", l.gated ? ops::gated_conv2d(x, weight, bias, params) : ops::conv2d(x, weight, bias, params));
  FastExecutor run(g, graphs::FormulaWeights::made_up(), {.precision = precision});
  const NamedTensors inputs = {{"x", Tensor::zeros(DType::kF32, x.shape())}};
  Profile profile;
  RunOptions options;
  options.profile = &profile;
  run.run(inputs, options);
  for (auto _ : state) run.run(inputs);
  state.counters["GFLOP/s"] =
      benchmark::Counter(2e-9 * profile[0].macs, benchmark::Counter::kIsIterationInvariantRate);
  state.SetLabel(profile[0].kernel + ", " + std::to_string(thread_count()) + " threads");
}

void register_layer(const char* name, const Layer& l) {
  for (const Precision precision : {Precision::kFp32, Precision::kBf16, Precision::kInt8})
    benchmark::RegisterBenchmark((std::string(name) + "/" + std::string(name_of(precision))).c_str(), layer,
                                 l, precision)
        ->UseRealTime();
}

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  register_layer("3x3_256", {256, 256, 3, 48, 1, 1, false});
  register_layer("3x3_64", {64, 64, 3, 96, 1, 1, false});
  register_layer("3x3_128_to_64", {128, 64, 3, 320, 1, 1, false});
  register_layer("1x1_1024_to_256", {1024, 256, 1, 24, 1, 1, false});
  register_layer("1x1_96_to_24", {96, 24, 1, 64, 1, 1, false});
  register_layer("gated_3x3_96_to_192", {96, 192, 3, 64, 1, 1, true});
  register_layer("first_7x7_s2", {3, 64, 7, 384, 2, 1, false});
  register_layer("3x3_64_to_1", {64, 1, 3, 320, 1, 1, false});
  register_layer("1x1_32_to_1", {32, 1, 1, 256, 1, 1, false});
  register_layer("grouped_32x8", {256, 256, 3, 96, 1, 32, false});
  register_layer("depthwise_3x3", {144, 144, 3, 96, 1, 144, false});
  benchmark::RunSpecifiedBenchmarks();
}
