#pragma once

#include "runtime/graph.h"

namespace slide::ops {

/// e^(x - max) / sum along one axis (negative: from the end).
Value softmax(Value x, int axis);

}  // namespace slide::ops
