#pragma once

#include "runtime/graph.h"

namespace slide::graphs {

/// The project's own matte network (weights_tools/train/matte_net.py): slide_depth's architecture with
/// weights of its own and a sigmoid at the end. Soft mattes of the salient subject.
/// @param x  1×3×H×W, RGB in [-1,1]; H and W multiples of 32. Throws Error(kUsage) for another shape.
/// @return 1×1×H×W in [0,1]
Value slide_matte(Value x);

}  // namespace slide::graphs
