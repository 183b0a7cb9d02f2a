#pragma once

#include <cstdint>

#include "runtime/graph.h"
#include "runtime/weights.h"

namespace slide::graphs {

/// What the shapes of a weight file decide about the coarse inpainting network.
struct InpaintCoarseConfig {
  /// Channels that come out of the first layer; those of the others are 1, 2, 4 or ½ times as many. 24 where
  /// the table's numbers count filters (48, half of which are gates), 48 where they count outputs (of 96
  /// filters).
  std::int64_t width = 24;
  std::int64_t image_channels = 4;  ///< 4: RGBD
  bool gated_last = false;          ///< the last layer is gated like all others

  /// Reads the shapes of the first and last layer. The default if `weights` makes tensors up. Throws
  /// Error(kBadWeights) if one is missing, or if they are of no network of this kind.
  static InpaintCoarseConfig from_weights(const WeightSource& weights);
};

/// The coarse RGBD inpainting network of SLIDE (Jampani et al., ICCV 2021, supplement, table T1):
/// DeepFillv2's gated convolutions, modules conv1 to conv16 as numbered in the table, then tanh.
/// @param image  1×C×H×W in [-1,1], C = image_channels; H and W multiples of 4
/// @param mask   1×1×H×W, 1 inside the hole
/// @return 1×C×H×W in [-1,1]
/// Throws Error(kUsage) for other shapes.
Value inpaint_coarse(Value image, Value mask, const InpaintCoarseConfig& config = {});

}  // namespace slide::graphs
