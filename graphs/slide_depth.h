#pragma once

#include <cstdint>

#include "runtime/graph.h"

namespace slide::graphs {

/// The project's own depth network (weights_tools/train/depth_net.py, 2.3 M parameters): a MobileNetV2
/// encoder (Sandler et al., CVPR 2018) with its batch norm folded into the convolutions, and a MiDaS-style
/// fusion decoder of 48 features with half-pixel bilinear enlargement. Strided layers of the encoder pad one
/// row below and one column at the right.
/// @param x  1×3×H×W, RGB in [-1,1]; H and W multiples of 32. Throws Error(kUsage) for another shape.
/// @return 1×1×H×W, relative inverse depth: larger is nearer, of no particular scale or sign
Value slide_depth(Value x);

/// The longer side of the picture that slide_depth and slide_matte work at.
inline constexpr std::int64_t kSlideSide = 384;

}  // namespace slide::graphs
