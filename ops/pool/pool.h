#pragma once

#include <array>
#include <cstdint>

#include "runtime/graph.h"

namespace slide::ops {

/// The attributes of a pooling window. Pairs are (vertical, horizontal).
struct PoolParams {
  std::array<std::int64_t, 2> kernel{2, 2};
  std::array<std::int64_t, 2> stride{2, 2};
  std::array<std::int64_t, 4> padding{0, 0, 0, 0};  ///< top, left, bottom, right; less than the kernel
  bool ceil_mode = false;          ///< round the output size up, as long as the last window starts inside
  bool count_include_pad = false;  ///< average pooling: padding counts as zeros (but never cells beyond it)
};

/// Maximum over a window of N×C×H×W; padding never wins; NaN if there is one in the window.
Value max_pool2d(Value x, const PoolParams& params);
/// Mean over a window of N×C×H×W.
Value avg_pool2d(Value x, const PoolParams& params);
/// Mean over all positions: N×C×H×W to N×C×1×1.
Value global_avg_pool2d(Value x);
/// PyTorch's adaptive average: output row i averages the input rows floor(i·H/height) to ceil((i+1)·H/height)
/// - 1.
Value adaptive_avg_pool2d(Value x, std::int64_t height, std::int64_t width);

}  // namespace slide::ops
