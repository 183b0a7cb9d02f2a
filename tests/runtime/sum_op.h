#pragma once

#include <array>

#include "runtime/error.h"
#include "runtime/graph.h"

namespace slide::test {

class SumOp;

/// float32 kernel of SumOp that also uses scratch memory, to test the arena.
class SumKernel : public Kernel {
 public:
  std::string_view name() const override { return "sum.plain"; }
  Isa isa() const override { return Isa::kBaseline; }
  bool supports(const Op&, std::span<const Shape>, const Shape&) const override { return true; }
  std::size_t scratch_bytes(const Op&, std::span<const Shape>, const Shape& output) const override {
    return static_cast<std::size_t>(output.count()) * sizeof(float);
  }
  double error_factor(const Op&, std::span<const Shape>) const override { return 1; }
  void run(const Op&, std::span<const Tensor> inputs, Tensor& output, const KernelCall& call) const override {
    auto* copy = static_cast<float*>(static_cast<void*>(call.scratch.data()));
    const std::span<float> y = output.mutable_data<float>();
    for (std::size_t i = 0; i < y.size(); ++i) copy[i] = inputs[0].data<float>()[i];
    for (std::size_t i = 0; i < y.size(); ++i) y[i] = copy[i] + inputs[1].data<float>()[i];
  }
};

/// y = a + b on equal shapes: the smallest operator there is.
class SumOp : public Op {
 public:
  std::string_view type() const override { return "sum"; }
  Shape infer(std::span<const Shape> inputs) const override {
    if (inputs[0] != inputs[1])
      throw Error(ErrorKind::kInternal, "cannot add " + inputs[0].text() + " and " + inputs[1].text());
    return inputs[0];
  }
  void reference(std::span<const Tensor> inputs, Tensor& output) const override {
    const std::span<double> y = output.mutable_data<double>();
    for (std::size_t i = 0; i < y.size(); ++i)
      y[i] = inputs[0].data<double>()[i] + inputs[1].data<double>()[i];
  }
  bool by_rows() const override { return true; }
  std::span<const Kernel* const> kernels() const override {
    static const SumKernel kernel;
    static const std::array<const Kernel*, 1> all{&kernel};
    return all;
  }
};

inline Value sum(Value a, Value b) { return a.graph().add(std::make_shared<SumOp>(), {a, b}); }

}  // namespace slide::test
