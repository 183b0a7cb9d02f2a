#pragma once

#include <cstddef>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "runtime/cpu.h"
#include "runtime/precision.h"
#include "runtime/shape.h"
#include "runtime/tensor.h"

namespace slide {

class Op;

/// The least and the largest value that a tensor is expected to hold.
struct Range {
  float low, high;
};

/// What a NaN or an infinity among a kernel's inputs may spoil.
enum class Reach {
  kDefinition,  ///< what the definition makes NaN or infinite of it, and nothing else
  kImage,       ///< all of the image (index along the first axis) that it is in; in a weight, of every image
};

/// Where a kernel's bound holds. Outside, an element may come out as NaN or an infinity, never as a wrong
/// number. Denormal inputs and results may count as zero at every kernel. NaN never becomes a number.
struct Domain {
  /// Of every input's finite elements.
  double largest_input = std::numeric_limits<float>::max();
  /// Of the kernel's error scale at an element: partial results are within it.
  double largest_scale = std::numeric_limits<float>::max();
  Reach reach = Reach::kDefinition;
};

/// What a kernel is given beside the tensors of a call.
struct KernelCall {
  std::span<const Shape> shapes;      ///< of the inputs; those that were packed may come as empty tensors
  std::span<const std::byte> packed;  ///< packed_bytes(), filled by pack()
  std::span<std::byte> scratch;       ///< scratch_bytes(), 64-byte aligned, uninitialised
  std::optional<Range> range;  ///< of the first input, from calibration; kernels without one measure it
};

/// One fast implementation of an operator. Tensors are float32, row-major, apart but for SharesStorage's.
class Kernel {
 public:
  virtual ~Kernel() = default;

  /// Family and method, "conv2d.im2col" say; unique among an operator's kernels of one ISA level.
  [[nodiscard]] virtual std::string_view name() const = 0;
  /// The level it was compiled for.
  [[nodiscard]] virtual Isa isa() const = 0;
  /// Both, as plans and profiles show them: "conv2d.im2col.avx2".
  [[nodiscard]] std::string name_and_level() const;
  /// What it multiplies with.
  [[nodiscard]] virtual Precision precision() const { return Precision::kFp32; }
  /// Whether it can do this call, and is worth it. `op` is always an operator that lists this kernel.
  [[nodiscard]] virtual bool supports(const Op& op, std::span<const Shape> inputs,
                                      const Shape& output) const = 0;
  /// Whether a plan should take it although kernels of lower precision may be used and support the shapes: it
  /// is faster than they are.
  [[nodiscard]] virtual bool replaces_lower(const Op& /*op*/, std::span<const Shape> /*inputs*/) const {
    return false;
  }
  /// Whether run() reads input `index` only in the form that pack() gave it.
  [[nodiscard]] virtual bool packs(std::size_t /*index*/) const { return false; }
  /// Bytes of that form.
  [[nodiscard]] virtual std::size_t packed_bytes(const Op& /*op*/, std::span<const Shape> /*inputs*/,
                                                 const Shape& /*output*/) const {
    return 0;
  }
  /// Brings the inputs that packs() names into the order in which run() reads them; the others are not looked
  /// at and may be empty; `shapes` are those of all. A plan does it once where the packed inputs are
  /// constant, else before each run.
  virtual void pack(const Op& /*op*/, std::span<const Tensor> /*inputs*/, std::span<const Shape> /*shapes*/,
                    std::span<std::byte> /*packed*/) const {}
  /// Bytes of scratch memory run() needs for this call.
  [[nodiscard]] virtual std::size_t scratch_bytes(const Op& /*op*/, std::span<const Shape> /*inputs*/,
                                                  const Shape& /*output*/) const {
    return 0;
  }
  /// The stated error: component by component |y - y64| <= factor · unit_roundoff() · scale, where scale
  /// comes from error_scale(). This is `factor` for a call of these shapes.
  [[nodiscard]] virtual double error_factor(const Op& op, std::span<const Shape> inputs) const = 0;
  /// u: 2^-24 for float32 arithmetic.
  [[nodiscard]] virtual double unit_roundoff() const { return 0x1p-24; }
  /// A method whose errors have another shape than Op::error_scale() writes its own scale (all F64) and
  /// returns true; else the operator's holds.
  virtual bool error_scale(const Op& /*op*/, std::span<const Tensor> /*inputs*/, const Tensor& /*output*/,
                           Tensor& /*scale*/) const {
    return false;
  }
  /// Where this bound holds.
  [[nodiscard]] virtual Domain domain() const { return {}; }
  /// Multiply-accumulates that it really does; Op::macs() unless the method saves some.
  [[nodiscard]] virtual double macs(const Op& op, std::span<const Shape> inputs, const Shape& output) const;
  /// The root mean square of its error relative to that of the result, as expected for exact inputs: for
  /// plans with an error budget (runtime/error_model.h), and no bound. By default 0.4·u·√error_factor(), what
  /// error_factor() independent roundings add up to.
  [[nodiscard]] virtual double expected_error(const Op& op, std::span<const Shape> inputs) const;
  /// Expected time, in multiply-accumulates of a direct float32 convolution of the same level: macs(), unless
  /// a kernel knows better. Compared between kernels of one operator only.
  [[nodiscard]] virtual double cost(const Op& op, std::span<const Shape> inputs, const Shape& output) const;
  /// Computes `output`, every element of it. Parallel inside through parallel_for.
  virtual void run(const Op& op, std::span<const Tensor> inputs, Tensor& output,
                   const KernelCall& call) const = 0;
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
  /// Whether row r of the result, along the first axis, depends on no other rows of those inputs that have as
  /// many axes and rows, so that reference() may be given some rows of them and of the result.
  [[nodiscard]] virtual bool by_rows() const { return false; }
  /// For each output element the positive number that rounding errors are measured against (F64, shape of the
  /// output): |w| ∗ |x| + |b| for a convolution, |y| for a pointwise function. The default is |y|.
  virtual void error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const;
  /// c of the definition's own bound: |y64 - y| <= c · 2^-53 · scale for the exact result y. By default 16
  /// and the terms of macs().
  [[nodiscard]] virtual double definition_factor(std::span<const Shape> inputs, const Shape& output) const;
  /// Multiply-accumulates of the definition; 0 where the count means nothing.
  [[nodiscard]] virtual double macs(std::span<const Shape> /*inputs*/, const Shape& /*output*/) const {
    return 0;
  }
  /// Which part of the squared relative error of input `index` the result takes over, as
  /// runtime/error_model.h has it. By default the input's part of all inputs' elements: for sums and
  /// concatenations of independent tensors of equal size.
  [[nodiscard]] virtual double error_share(std::size_t index, std::span<const Shape> inputs) const;
  /// The fast kernels, best first. Every operator has at least one for Isa::kBaseline.
  [[nodiscard]] virtual std::span<const Kernel* const> kernels() const = 0;
};

}  // namespace slide
