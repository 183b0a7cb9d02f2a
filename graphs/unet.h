#pragma once

#include <cstdint>

#include "runtime/graph.h"

namespace slide::graphs {

/// The U-Net of slide_inpaint and slide_rim (weights_tools/train/inpaint_net.py, rim_net.py): 13 convolutions,
/// conv1 to conv13, at the size of x, its half, quarter and eighth, with dilations of 2, 4 and 8 at the
/// eighth; bilinear enlargements on the way back; ReLU behind all but the last.
/// @param x       1×C×H×W; H and W multiples of 8
/// @param eighth  channels at the eighth; at the half there are 16, at the quarter 32
/// @param last    channels on the way back, at the half and at the full size
/// @return 1×1×H×W, of any range
Value small_unet(Value x, std::int64_t eighth, std::int64_t last);

/// The probability whose odds are those of p, times e^change: p / (p + (1 - p)·e^-change).
Value moved_by_log_odds(Value p, Value change);

}  // namespace slide::graphs
