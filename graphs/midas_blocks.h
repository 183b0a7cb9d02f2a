#pragma once

#include <cstdint>
#include <string_view>

#include "runtime/graph.h"

namespace slide::graphs {

/// What the two MiDaS v2.1 networks have in common (Ranftl et al., "Towards Robust Monocular Depth
/// Estimation", TPAMI 2020; isl-org/MiDaS midas/blocks.py): the RefineNet decoder over four encoder levels,
/// and the head.

/// Which value a residual unit adds to its branch. The large network's ReLU works in place, so that its skip
/// connection carries the rectified input; the small one's does not.
enum class ResidualSkip { kRectified, kAsGiven };

/// ResidualConvUnit: skip + conv2(relu(conv1(relu(x)))).
Value residual_conv_unit(Value x, std::string_view name, ResidualSkip skip);

/// FeatureFusionBlock: the path from below and, if there is one, this level's features through resConfUnit1,
/// added; then resConfUnit2 and bilinear ×2 with aligned corners. With `out_channels` a 1×1 convolution
/// out_conv follows.
struct FusionBlock {
  ResidualSkip skip;
  std::int64_t out_channels = 0;       ///< 0: no out_conv
  std::int64_t height = 0, width = 0;  ///< replace ×2 if not 0
};
Value fuse_features(Value path, const FusionBlock& block, std::string_view name);
Value fuse_features(Value path, Value level, const FusionBlock& block, std::string_view name);

/// output_conv: 3×3, bilinear ×2, 3×3 to 32 channels, ReLU, 1×1 to one channel, ReLU.
Value depth_head(Value x, std::int64_t channels);

}  // namespace slide::graphs
