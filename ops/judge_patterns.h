#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "ops/case_io.h"

namespace slide::ops {

/// A result with its wrong elements, ascending.
struct WrongResult {
  const OperatorCase& operator_case;
  const Tensor& expected;  ///< F64
  const Tensor& actual;    ///< F64, of the same shape
  std::span<const std::size_t> wrong;
};

/// What the wrong elements have in common: where they lie along each axis (one index, the last index, every
/// n-th), and how their values differ (NaN, a constant factor, a shift by one along an axis, the bias
/// missing). At most six clauses; none if nothing is wrong.
[[nodiscard]] std::vector<std::string> patterns_of(const WrongResult& result);

}  // namespace slide::ops
