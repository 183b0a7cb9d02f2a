#pragma once

#include <vector>

#include "runtime/graph.h"

namespace slide::ops {

/// Reductions over the given axes (negative: from the end); the axes stay with extent 1.
/// NaN among the elements gives NaN.
Value reduce_min(Value x, const std::vector<int>& axes);
Value reduce_max(Value x, const std::vector<int>& axes);
Value reduce_mean(Value x, const std::vector<int>& axes);

}  // namespace slide::ops
