#pragma once

#include <cstdint>

#include "runtime/graph.h"

namespace slide::ops {

/// Scaled dot-product attention (Vaswani et al. 2017, eq. 1) of several heads, with tokens along the last two
/// axes, as a 1×1 convolution makes them: channels [h·C/heads, (h + 1)·C/heads) of each tensor are head h's.
/// For each head and query position i, with k_j, v_j the head's channels at key position j:
/// \code
/// y_i = sum over j of softmax_j(scale · q_i·k_j) · v_j
/// \endcode
/// @param query  N×C×H×W
/// @param key    N×C×H'×W'
/// @param value  N×D×H'×W'; C and D are multiples of heads
/// @return N×D×H×W
Value attention(Value query, Value key, Value value, std::int64_t heads, double scale);

}  // namespace slide::ops
