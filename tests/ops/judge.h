#pragma once

#include <doctest/doctest.h>

#include <functional>
#include <string>
#include <vector>

#include "kernel_bounds.h"
#include "ops/check.h"
#include "runtime/error.h"

namespace slide::test {

/// Checks every kernel of every level this CPU runs on a call: its stated bound, guard words, elements left
/// unwritten, one thread against several. NaN and infinities must come out where the definition has them.
inline void judge(const Call& call) {
  const ops::KernelTask task = ops::make_task(*call.op, call.inputs);
  const std::vector<Isa> levels = available_isas();
  std::size_t count = 0;
  for (const Kernel* kernel : call.op->kernels()) {
    if (std::find(levels.begin(), levels.end(), kernel->isa()) == levels.end()) continue;
    if (!kernel->supports(*call.op, call.input_shapes(), call.shape)) continue;
    const ops::KernelCheck check = ops::check_kernel(*kernel, task, true);
    INFO(check.kernel, " ", call.op->attributes(), ": ", check.verdict(), ", ", check.of_bound,
         " of its bound");
    CHECK(check.passed());
    ++count;
  }
  CHECK(count > 0);
}

/// An operator of one input.
inline Call call_of(Tensor x, const std::function<Value(Value)>& build) {
  return {{std::move(x)}, [&](const std::vector<Value>& v) { return build(v[0]); }};
}

/// A tensor of the numbers given.
inline Tensor tensor_of(const Shape& shape, const std::vector<double>& values) {
  return Tensor::from<double>(shape, std::span<const double>(values));
}

/// A tensor of value(flat index).
inline Tensor tensor_by(const Shape& shape, const std::function<double(std::int64_t)>& value) {
  Tensor t(DType::kF64, shape);
  for (std::int64_t i = 0; i < t.count(); ++i)
    t.mutable_data<double>()[static_cast<std::size_t>(i)] = value(i);
  return t;
}

inline std::vector<double> values(const Tensor& t) {
  const std::span<const double> v = t.data<double>();
  return {v.begin(), v.end()};
}

/// The message of the Error that `build` throws; empty if it throws none.
inline std::string refusal(const std::function<void()>& build) {
  try {
    build();
  } catch (const Error& e) {
    return e.what();
  }
  return "";
}

}  // namespace slide::test
