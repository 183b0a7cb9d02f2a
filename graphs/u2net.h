#pragma once

#include <array>

#include "runtime/graph.h"

namespace slide::graphs {

/// U²-Net (Qin et al., "U²-Net: Going Deeper with Nested U-Structure for Salient Object Detection", Pattern
/// Recognition 2020; xuebinqin/U-2-Net model/u2net.py).
/// @param x  1×3×H×W of any size, RGB normalised with ImageNet's mean and standard deviation; the authors work
///           at 320×320. Throws Error(kUsage) for another shape.
/// @return seven maps of 1×1×H×W in [0,1]: the fused one, which is used, and the six side outputs, finest first
std::array<Value, 7> u2net(Value x);

/// The small variant: 16 channels inside every block, 64 between them.
std::array<Value, 7> u2netp(Value x);

}  // namespace slide::graphs
