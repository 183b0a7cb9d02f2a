#pragma once

#include <cstdint>

#include "runtime/graph.h"

namespace slide::ops {

/// Median of each plane of N×C×H×W over windows of (2·radius + 1)² pixels; the border is replicated, so the
/// count is odd and the result one of the values. NaN counts as the largest. radius = 0 is the identity.
/// Exact; the kernel's cost per pixel grows with the radius, not with its square.
/// Throws Error(kInternal) naming the layer if the radius is negative or over 1024.
Value median(Value x, std::int64_t radius);

}  // namespace slide::ops
