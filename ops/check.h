#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "ops/case_io.h"
#include "runtime/cpu.h"
#include "runtime/op.h"

namespace slide::ops {

/// A call that kernels are judged on. Inputs are rounded to float32 first, and the definition is run on these
/// rounded inputs, so that only the kernel's own arithmetic counts.
struct KernelTask {
  const Op* op = nullptr;
  std::vector<Tensor> inputs;  ///< F32; denormals are zero, as in a run of the fast executor
  Tensor reference;            ///< y64: the definition in float64 on `inputs`
  Tensor scale;                ///< Op::error_scale(), F64
};

/// Rounds the inputs (any element type), infers the output's shape and runs the definition.
[[nodiscard]] KernelTask make_task(const Op& op, std::span<const Tensor> inputs);

/// A kernel's RMS error may be this many times what its arithmetic predicts. The prediction is for results
/// that are sums of independent terms, whose scale is about √terms times the result (in RMS). Where terms
/// cancel twice as much or more, it grows in proportion; where they cancel 16 times as much, the terms are
/// equal or nearly so, roundings of equal weights are equal, too, and nothing is predicted.
inline constexpr double kRmsFactor = 4;

/// How one kernel did on one call. Relative errors are maxima over all elements, divided by the largest
/// finite magnitude of what they are relative to; where both values are NaN or the same infinity there is no
/// error, and one NaN alone is an infinite one. A result that is beyond float32's range must come out as that
/// infinity.
struct KernelCheck {
  std::string kernel;  ///< name and level: "conv2d.im2col.avx2"
  Isa isa = Isa::kBaseline;
  double error_expected = 0;   ///< relative, against the expected output given; 0 where there is none
  double error_reference = 0;  ///< relative, against y64
  double rms = 0;              ///< of y - y64 over finite elements, but for flushing, relative to that of y64
  double expected_rms = 0;     ///< Kernel::expected_error(), more or 0 where results cancel: see kRmsFactor
  std::int64_t outside = 0;    ///< elements outside the kernel's domain that are NaN or infinite
  double of_bound = 0;         ///< max |y - y64| / bound with the kernel's stated bound
      ///< factor · u · scale + max(factor, 1) · 2^-126 (what flushing denormals may cost)
  double factor = 0;           ///< Kernel::error_factor()
  std::int64_t unwritten = 0;  ///< output elements that still hold what the output was filled with
  bool guards_intact = true;   ///< nothing was written beside the output or the scratch memory
  bool same_at_any_thread_count = true;
  std::string problem;  ///< the message of the exception it threw, if it did
  Tensor output;        ///< F32; empty if it threw

  [[nodiscard]] bool passed() const noexcept {
    return of_bound <= 1 && !unexpected() && unwritten == 0 && guards_intact && same_at_any_thread_count &&
           problem.empty();
  }
  /// Whether the error is much larger than the arithmetic predicts: a constant is off, or a step is less
  /// exact than it should be, although every element is within its bound.
  [[nodiscard]] bool unexpected() const noexcept {
    return expected_rms > 0 && rms > kRmsFactor * expected_rms;
  }
  /// Whether little is left of the result, be it within the bound or not: its terms cancel farther than the
  /// kernel's precision reaches.
  [[nodiscard]] bool result_lost() const noexcept { return rms > kLost; }
  static constexpr double kLost = 0.1;
  /// What is wrong, in a few words; empty if passed().
  [[nodiscard]] std::string verdict() const;
};

/// Runs a kernel on a task: output and scratch memory lie between guard words and are filled with NaN before,
/// denormals are flushed. With `thread_counts` it is run a second time with another number of threads and the
/// bytes are compared.
[[nodiscard]] KernelCheck check_kernel(const Kernel& kernel, const KernelTask& task,
                                       bool thread_counts = false);

/// How an operator and its kernels did on one case.
struct CaseCheck {
  std::string op;
  std::string attributes;
  std::string source;
  Shape shape;                 ///< of the expected output
  double reference_error = 0;  ///< of the definition in float64, relative, against the expected output
  double of_tolerance = 0;     ///< the largest quotient of that error, by element, and what may be lost
  std::vector<KernelCheck> kernels;

  [[nodiscard]] bool reference_passed() const noexcept { return of_tolerance <= 1; }
  [[nodiscard]] bool passed() const noexcept;
};

/// Checks the definition, element by element, against
///     |y64 - expected| <= c · 2^-53 · scale + own · textbook + 2^-126
/// with c from Op::definition_factor(). The second term is what the program that gave the expected output may
/// have lost: `own` is c · 2^-53 where that is stored in float64, and what judge() allows a float32 result,
/// float_factor() · 2^-24, where it is stored in float32; `textbook` is of ops/textbook_scale.h. Then every
/// kernel of levels up to `isa` that can do the call. Throws Error(kBadInput) if the operator or its
/// attributes are unknown or do not fit the tensors.
[[nodiscard]] CaseCheck check_case(const OperatorCase& operator_case, Isa isa);

/// max |a - b| over all elements, divided by the largest finite |b|; see KernelCheck. Any floating dtypes;
/// infinite if the shapes differ.
[[nodiscard]] double relative_error(const Tensor& a, const Tensor& b);

}  // namespace slide::ops
