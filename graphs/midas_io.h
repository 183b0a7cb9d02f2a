#pragma once

#include <cstdint>

#include "runtime/graph.h"

namespace slide::graphs {

/// Height and width of an image.
struct ImageSize {
  std::int64_t height, width;
  friend bool operator==(const ImageSize&, const ImageSize&) = default;
};

/// The size that MiDaS works at for an image (isl-org/MiDaS midas/transforms.py, Resize with
/// keep_aspect_ratio, ensure_multiple_of = 32 and "upper_bound"): scaled so that the longer side is
/// `upper_bound`, then both sides to the nearest multiple of 32, a tie to the even multiple, that is not
/// above `upper_bound`. A side is at least 32, where the authors' code would make it 0. Throws Error(kUsage)
/// unless all numbers are positive and upper_bound is at least 32.
[[nodiscard]] ImageSize midas_working_size(ImageSize image, std::int64_t upper_bound);

/// (x - mean) / std with ImageNet's mean and standard deviation of each channel.
/// @param image  1×3×H×W, RGB in [0,1]
Value imagenet_normalise(Value image);

/// Bicubic resizing to the working size (a = -0.75, half-pixel centres, as OpenCV's INTER_CUBIC), then
/// imagenet_normalise().
/// @param image  1×3×H×W, RGB in [0,1]
/// @return 1×3×size, unclamped
Value midas_preprocess(Value image, ImageSize size);

/// Bicubic resizing (a = -0.75, half-pixel centres) of a depth map 1×1×h×w back to the image's size, as the
/// authors do with torch.
Value midas_postprocess(Value depth, ImageSize image);

}  // namespace slide::graphs
