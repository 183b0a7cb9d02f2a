#pragma once

#include <array>
#include <cstdint>

#include "graphs/midas_io.h"
#include "runtime/graph.h"

namespace slide::graphs {

/// The sizes in which Depth Anything V2 is published (depth_anything_v2/dpt.py, dinov2.py).
struct DepthAnythingV2Config {
  std::int64_t embed_dim;
  std::int64_t depth;  ///< blocks
  std::int64_t heads;
  std::array<std::int64_t, 4> layers;        ///< the blocks whose results the head reads
  std::int64_t features;                     ///< of the head
  std::array<std::int64_t, 4> out_channels;  ///< of its four levels
};
inline constexpr DepthAnythingV2Config kDepthAnythingV2Small{384,           12, 6,
                                                             {2, 5, 8, 11}, 64, {48, 96, 192, 384}};
inline constexpr DepthAnythingV2Config kDepthAnythingV2Base{768,           12,  12,
                                                            {2, 5, 8, 11}, 128, {96, 192, 384, 768}};
inline constexpr DepthAnythingV2Config kDepthAnythingV2Large{
    1024, 24, 16, {4, 11, 17, 23}, 256, {256, 512, 1024, 1024}};

/// Depth Anything V2 (Yang et al., NeurIPS 2024; DepthAnything/Depth-Anything-V2): a DINOv2 vision
/// transformer (Oquab et al. 2023) on patches of 14×14 pixels, and a DPT head (Ranftl et al., ICCV 2021).
/// @param x  1×3×H×W, RGB normalised with ImageNet's mean and standard deviation
///           (midas_preprocess()); H and W multiples of 14. Throws Error(kUsage) otherwise.
/// @return 1×1×H×W, disparity up to scale and shift (larger is nearer), >= 0
Value depth_anything_v2(Value x, const DepthAnythingV2Config& config);

/// The size that the authors work at for an image (depth_anything_v2/dpt.py image2tensor(), util/transform.py
/// Resize with keep_aspect_ratio, ensure_multiple_of = 14 and "lower_bound"): scaled so that the shorter side
/// is `shorter`, then both sides to the nearest multiple of 14, a tie to the even multiple, that is not below
/// `shorter`. Throws Error(kUsage) unless all numbers are positive.
[[nodiscard]] ImageSize depth_anything_working_size(ImageSize image, std::int64_t shorter = 518);

/// Bilinear resizing with aligned corners of a depth map 1×1×h×w back to the image's size, as the authors'
/// infer_image() does.
Value depth_anything_postprocess(Value depth, ImageSize image);

}  // namespace slide::graphs
