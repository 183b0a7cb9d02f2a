#pragma once

#include <optional>

#include "render/image.h"

namespace slide {

/// One layer of a 3D photo: a textured height field (docs/method.md, section 6).
struct Layer {
  Image colour;     ///< H×W×3, [0, 1]
  Image disparity;  ///< H×W×1, [0, 1]: 1 is nearest, 0 is farthest
  Image alpha;      ///< H×W×1, [0, 1], the visibility A; empty means opaque everywhere
};

/// A 3D photo: what the photo shows, and what lies behind it where that can come into view.
struct Layers {
  Layer foreground;
  std::optional<Layer> background;  ///< same size as the foreground; opaque, its alpha is not used
};

/// Refuses layers that cannot be rendered: sizes that differ between the maps or the layers, wrong channel
/// counts, no pixels, more than kMaxLayerSide pixels a side, NaN or infinite values, disparity or alpha
/// outside [0, 1]. The message names the layer, the map and the first such pixel.
/// @throws Error(kBadInput)
void check_layers(const Layers& layers);

/// The largest width and height of a layer.
inline constexpr int kMaxLayerSide = 16384;

}  // namespace slide
