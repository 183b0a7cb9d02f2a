#pragma once

#include <cstdint>
#include <optional>

#include "runtime/graph.h"

namespace slide::ops {

/// The attributes of contextual attention (Yu et al., "Generative Image Inpainting with Contextual
/// Attention", CVPR 2018, section 4), as DeepFillv2 uses it.
struct ContextualAttentionParams {
  std::int64_t patch = 3;       ///< side of the patches that are matched, at the reduced resolution
  std::int64_t rate = 2;        ///< the features are reduced by this factor for matching
  double softmax_scale = 10.0;  ///< multiplies the scores before the softmax
  std::int64_t fuse = 3;        ///< side of the kernel that makes neighbouring matches agree
};

/// Fills masked positions with a score-weighted mixture of patches from unmasked positions.
/// @param foreground  1×C×H×W, what is to be filled; H and W multiples of rate
/// @param background  1×C×H×W, where patches come from (the same tensor in DeepFillv2)
/// @param mask        1×1×MH×MW, 1 inside the hole, at any whole multiple of the features' resolution
/// @param fuse_weight 1×1×fuse×fuse, the kernel that slides along (background position, foreground position),
///                    first in row-major and then in column-major order of both, zeros outside; without it
///                    the identity matrix. It is a buffer of the authors' module (the identity in their
///                    files), and any 3×3 kernel in the golden files.
/// @return 1×C×H×W
Value contextual_attention(Value foreground, Value background, Value mask,
                           const ContextualAttentionParams& params,
                           std::optional<Value> fuse_weight = std::nullopt);

}  // namespace slide::ops
