#pragma once

#include <vector>

#include "render/camera.h"

namespace slide {

/// How much all views must zoom in so that the photo's edge never shows: the smallest factor >= 1 by which
/// every point of the photo's border, at any disparity in [0, 1], appears on or outside of the frame that it
/// bounds, in every view. At most 2: where the path moves farther than that, edges show.
[[nodiscard]] double edge_zoom(const Camera& camera, const std::vector<View>& views);

/// The views with their zoom multiplied by edge_zoom() about the photo's centre.
[[nodiscard]] std::vector<View> without_edges(const Camera& camera, std::vector<View> views);

/// The smallest part of a frame, over the views, that the photo covers if all of it has the disparity, 0 or
/// 1, that leaves more of the frame empty. Asked at 32×32 places of each frame.
[[nodiscard]] double least_coverage(const Camera& camera, const std::vector<View>& views);

}  // namespace slide
