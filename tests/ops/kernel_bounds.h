#pragma once

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "runtime/cpu.h"
#include "runtime/graph.h"
#include "runtime/threads.h"

namespace slide::test {

/// Float32 numbers with a normal distribution, the same on every machine, widened to F64.
inline Tensor random_tensor(const Shape& shape, unsigned seed, double sigma = 1) {
  std::mt19937 generator(seed);
  Tensor t(DType::kF64, shape);
  for (double& v : t.mutable_data<double>()) {
    double sum = -6;  // Irwin and Hall: twelve uniform numbers
    for (int i = 0; i < 12; ++i) sum += static_cast<double>(generator()) * 0x1p-32;
    v = static_cast<double>(static_cast<float>(sum * sigma));
  }
  return t;
}

/// One operator applied to tensors, built through its public function.
struct Call {
  Graph graph;
  std::vector<Tensor> inputs;  // F64
  std::shared_ptr<const Op> op;
  Shape shape;

  /// `build` is given the values that stand for the inputs and returns the operator's.
  template <typename Build>
  Call(std::vector<Tensor> tensors, const Build& build) : inputs(std::move(tensors)) {
    std::vector<Value> values;
    for (std::size_t i = 0; i < inputs.size(); ++i)
      values.push_back(graph.input("x" + std::to_string(i), inputs[i].shape()));
    const Value result = build(values);
    op = graph.node(result.node()).op;
    shape = result.shape();
  }

  [[nodiscard]] Tensor reference() const {
    Tensor y(DType::kF64, shape);
    std::ranges::fill(y.mutable_data<double>(), std::numeric_limits<double>::quiet_NaN());
    op->reference(inputs, y);
    return y;
  }
  [[nodiscard]] Tensor error_scale(const Tensor& y) const {
    Tensor scale(DType::kF64, shape);
    op->error_scale(inputs, y, scale);
    return scale;
  }
  [[nodiscard]] std::vector<Shape> input_shapes() const {
    std::vector<Shape> shapes;
    for (const Tensor& t : inputs) shapes.push_back(t.shape());
    return shapes;
  }
};

/// Runs a kernel on float32 inputs. Output and scratch memory are NaN before and lie between guard words,
/// which are checked after.
inline std::vector<float> run_guarded(const Kernel& kernel, const Call& call,
                                      const std::vector<Tensor>& inputs) {
  constexpr std::size_t kGuard = 64;
  constexpr float kGuardWord = -1234.5F;
  const auto count = static_cast<std::size_t>(call.shape.count());
  std::vector<float> memory(count + 2 * kGuard, kGuardWord);
  std::fill_n(memory.begin() + kGuard, count, std::numeric_limits<float>::quiet_NaN());
  Tensor output = Tensor::view(DType::kF32, call.shape, memory.data() + kGuard);
  const std::size_t scratch_bytes = kernel.scratch_bytes(*call.op, call.input_shapes(), call.shape);
  Tensor scratch(DType::kU8, Shape{static_cast<std::int64_t>(scratch_bytes + kGuard)});
  std::memset(scratch.mutable_raw().data(), 0xFF, scratch_bytes);  // NaN
  std::memset(scratch.mutable_raw().data() + scratch_bytes, 0x5A, kGuard);
  const std::size_t packed_bytes = kernel.packed_bytes(*call.op, call.input_shapes(), call.shape);
  Tensor packed(DType::kU8, Shape{static_cast<std::int64_t>(packed_bytes + kGuard)});
  std::memset(packed.mutable_raw().data(), 0xFF, packed_bytes);
  std::memset(packed.mutable_raw().data() + packed_bytes, 0x5A, kGuard);
  kernel.pack(*call.op, inputs, call.input_shapes(), packed.mutable_raw().first(packed_bytes));
  const std::vector<Shape> shapes = call.input_shapes();
  kernel.run(
      *call.op, inputs, output,
      {shapes, packed.raw().first(packed_bytes), scratch.mutable_raw().first(scratch_bytes), std::nullopt});
  for (std::size_t i = 0; i < kGuard; ++i) {
    REQUIRE(memory[i] == kGuardWord);
    REQUIRE(memory[kGuard + count + i] == kGuardWord);
    REQUIRE(scratch.raw()[scratch_bytes + i] == std::byte{0x5A});
    REQUIRE(packed.raw()[packed_bytes + i] == std::byte{0x5A});
  }
  return {memory.begin() + kGuard, memory.begin() + kGuard + static_cast<std::ptrdiff_t>(count)};
}

/// The largest error of a kernel's output, as a multiple of its stated bound; infinite if one is NaN where
/// the reference is not.
inline double error_in_bounds(const std::vector<float>& y, const Tensor& exact, const Tensor& scale,
                              double bound) {
  const std::span<const double> e = exact.data<double>();
  const std::span<const double> s = scale.data<double>();
  double worst = 0;
  for (std::size_t i = 0; i < y.size(); ++i) {
    if (std::isnan(e[i]) && std::isnan(y[i])) continue;
    const double error = std::fabs(static_cast<double>(y[i]) - e[i]);
    if (error == 0) continue;
    const double ratio = error / (bound * s[i]);
    worst = std::isnan(ratio) ? std::numeric_limits<double>::infinity() : std::max(worst, ratio);
  }
  return worst;
}

/// How many levels this CPU runs for which every kernel is compiled, not products of words alone.
inline int whole_levels() {
  const std::vector<Isa> levels = available_isas();
  constexpr std::array kWordLevels = {Isa::kAvxVnni, Isa::kAvx512Vnni, Isa::kAmx,
                                      Isa::kNeonDot, Isa::kNeonI8mm,   Isa::kNeonBf16};
  return static_cast<int>(std::ranges::count_if(
      levels, [&](Isa isa) { return std::ranges::find(kWordLevels, isa) == kWordLevels.end(); }));
}

/// Checks every kernel of every level this CPU runs against the reference and its own stated bound, and that
/// one and three threads give the same bytes. Returns the number of kernels that ran, so that a test can ask
/// for some.
inline int check_kernels(const Call& call, bool flush_denormals = false) {
  const Tensor exact = call.reference();
  const Tensor scale = call.error_scale(exact);
  std::vector<Tensor> inputs;
  for (const Tensor& t : call.inputs) inputs.push_back(t.to(DType::kF32));
  const std::vector<Shape> shapes = call.input_shapes();
  const std::vector<Isa> levels = available_isas();
  int count = 0;
  for (const Kernel* kernel : call.op->kernels()) {
    if (std::find(levels.begin(), levels.end(), kernel->isa()) == levels.end()) continue;
    if (!kernel->supports(*call.op, shapes, call.shape)) continue;
    ++count;
    INFO(std::string(kernel->name()), " ", std::string(name_of(kernel->isa())), " ", call.op->attributes());
    std::optional<FlushDenormals> flush;
    if (flush_denormals) flush.emplace();
    set_thread_count(1);
    const std::vector<float> y = run_guarded(*kernel, call, inputs);
    set_thread_count(3);
    const std::vector<float> again = run_guarded(*kernel, call, inputs);
    set_thread_count(0);
    flush.reset();
    CHECK(std::memcmp(y.data(), again.data(), y.size() * sizeof(float)) == 0);
    Tensor own(DType::kF64, call.shape);
    const bool has_own = kernel->error_scale(*call.op, call.inputs, exact, own);
    CHECK(error_in_bounds(y, exact, has_own ? own : scale,
                          kernel->error_factor(*call.op, shapes) * kernel->unit_roundoff()) <= 1);
  }
  return count;
}

}  // namespace slide::test
