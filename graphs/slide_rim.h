#pragma once

#include "runtime/graph.h"

namespace slide::graphs {

/// The project's own matting network (weights_tools/train/rim_net.py): corrects a coarse matte that was
/// enlarged to the photo's size, where it cannot be right: the edge, hair, gaps. It sees the photo, the matte m,
/// and how near each pixel's colour is to those of subject and background nearby, and gives a change c of the
/// log odds of being the subject: with p = 0.02 + 0.96·m,
/// m' = clip((p / (p + (1 - p)·e^-c) - 0.08) / 0.84, 0, 1). Where c is zero, m' = clip(8/7·(m - 1/16), 0, 1).
/// @param image   1×3×H×W in [0, 1]; H and W multiples of 8
/// @param coarse  1×1×H×W in [0, 1]
/// @return 1×1×H×W in [0, 1]
/// Throws Error(kUsage) for other shapes.
Value slide_rim(Value image, Value coarse);

}  // namespace slide::graphs
