#pragma once

#include <cstdint>

#include "runtime/graph.h"
#include "runtime/weights.h"

namespace slide::graphs {

/// What the shapes of a weight file decide about the two-stage inpainting network.
struct InpaintDeepfillConfig {
  std::int64_t cnum = 48;           ///< the authors' channel number; layers have ¼ to 4 times as many
  std::int64_t image_channels = 4;  ///< 4: RGBD; 3: the published RGB weights

  /// Reads the shape of the first layer. The default if `weights` makes tensors up. Throws Error(kBadWeights)
  /// if it is missing, or of no network of this kind.
  static InpaintDeepfillConfig from_weights(const WeightSource& weights);
};

/// Coarse and refined result.
struct InpaintDeepfillResult {
  Value coarse, refined;
};

/// DeepFillv2's generator (Yu et al., "Free-Form Image Inpainting with Gated Convolution", ICCV 2019;
/// nipponjo/deepfillv2-pytorch model/networks.py): a coarse network, then a refinement network of two
/// branches, one dilated, one with contextual attention.
/// @param image  1×C×H×W in [-1,1], C = image_channels; H and W multiples of 8
/// @param mask   1×1×H×W, 1 inside the hole
/// @return both 1×C×H×W in [-1,1]; what is outside the hole is for the caller to paste back
/// Throws Error(kUsage) for other shapes.
InpaintDeepfillResult inpaint_deepfill(Value image, Value mask, const InpaintDeepfillConfig& config = {});

}  // namespace slide::graphs
