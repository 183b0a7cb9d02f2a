#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "runtime/cpu.h"
#include "runtime/shape.h"
#include "runtime/tensor.h"

namespace slide {

class Op;

/// One fast implementation of an operator. Tensors are float32, row-major, and never alias.
class Kernel {
 public:
  virtual ~Kernel() = default;

  /// Family and method, "conv2d.im2col" say; unique among an operator's kernels of one ISA level.
  [[nodiscard]] virtual std::string_view name() const = 0;
  /// The level it was compiled for.
  [[nodiscard]] virtual Isa isa() const = 0;
  /// Whether it can do this call. `op` is always an operator that lists this kernel.
  [[nodiscard]] virtual bool supports(const Op& op, std::span<const Shape> inputs,
                                      const Shape& output) const = 0;
  /// Bytes of scratch memory run() needs for this call (64-byte aligned, uninitialised).
  [[nodiscard]] virtual std::size_t scratch_bytes(const Op& /*op*/, std::span<const Shape> /*inputs*/,
                                                  const Shape& /*output*/) const {
    return 0;
  }
  /// The stated error: component by component |y - y64| <= factor · unit_roundoff() · scale, where scale
  /// comes from Op::error_scale(). This is `factor` for a call of these shapes.
  [[nodiscard]] virtual double error_factor(const Op& op, std::span<const Shape> inputs) const = 0;
  /// u: 2^-24 for float32 arithmetic.
  [[nodiscard]] virtual double unit_roundoff() const { return 0x1p-24; }
  /// Computes `output`, every element of it. Parallel inside through parallel_for.
  virtual void run(const Op& op, std::span<const Tensor> inputs, Tensor& output,
                   std::span<std::byte> scratch) const = 0;
};

/// One operator with its attributes: what it computes, as plainly as it can be written, and its fast kernels.
/// Objects are immutable; a graph shares them.
class Op {
 public:
  virtual ~Op() = default;

  /// The family's name: "conv2d", "resize".
  [[nodiscard]] virtual std::string_view type() const = 0;
  /// The attributes as readable text: "3x3 stride 2 dilation 1"; may be empty.
  [[nodiscard]] virtual std::string attributes() const { return ""; }
  /// The output's shape. Throws Error(kInternal) saying what does not fit, both shapes named.
  [[nodiscard]] virtual Shape infer(std::span<const Shape> inputs) const = 0;
  /// The definition, in float64: inputs and output are F64 tensors of the inferred shape. May run in
  /// parallel, but every output element is computed in one fixed order.
  virtual void reference(std::span<const Tensor> inputs, Tensor& output) const = 0;
  /// For each output element the positive number that rounding errors are measured against (F64, shape of the
  /// output): |w| ∗ |x| + |b| for a convolution, |y| for a pointwise function. The default is |y|.
  virtual void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const;
  /// Multiply-accumulates of the definition; 0 where the count means nothing.
  [[nodiscard]] virtual double macs(std::span<const Shape> /*inputs*/, const Shape& /*output*/) const {
    return 0;
  }
  /// The fast kernels, best first. Every operator has at least one for Isa::kBaseline.
  [[nodiscard]] virtual std::span<const Kernel* const> kernels() const = 0;
};

}  // namespace slide
