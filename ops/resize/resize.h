#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "runtime/graph.h"

namespace slide::ops {

enum class ResizeMode { kNearest, kLinear, kCubic };

/// Which input coordinate an output index i stands for, s = output size / input size (or the scale given):
enum class ResizeCoordinates {
  kHalfPixel,         ///< (i + 1/2) / s - 1/2
  kPytorchHalfPixel,  ///< the same, but 0 where the output size is 1
  kAlignCorners,      ///< i · (input - 1) / (output - 1); 0 where the output size is 1
  kAsymmetric,        ///< i / s
};

/// How nearest rounds the coordinate (ONNX's names).
enum class NearestRounding { kFloor, kCeil, kRoundPreferFloor, kRoundPreferCeil };

struct ResizeParams {
  ResizeMode mode = ResizeMode::kLinear;
  ResizeCoordinates coordinates = ResizeCoordinates::kHalfPixel;
  std::array<std::int64_t, 2> size{0, 0};             ///< output height and width, >= 1
  std::optional<std::array<double, 2>> scale;         ///< replaces output/input in the formulas above
  NearestRounding nearest = NearestRounding::kFloor;  ///< with kNearest
  double cubic_a = -0.75;  ///< Keys' parameter: -0.75 as OpenCV and PyTorch, -0.5 as others
};

/// Resamples the last two axes of N×C×H×W. Samples beyond the border replicate it. No anti-aliasing:
/// shrinking reads 1, 2×2 or 4×4 samples, as the frameworks do.
Value resize(Value x, const ResizeParams& params);

/// Bilinear to a size, as torch.nn.functional.interpolate(mode='bilinear') computes it.
Value resize_bilinear(Value x, std::int64_t height, std::int64_t width, bool align_corners);
/// The same to twice the size, without aligned corners.
Value upsample_bilinear(Value x);
/// Bicubic (a = -0.75, half-pixel) to a size, as torch and OpenCV compute it.
Value resize_bicubic(Value x, std::int64_t height, std::int64_t width);
/// Nearest, each pixel repeated factor × factor times.
Value upsample_nearest(Value x, std::int64_t factor);

}  // namespace slide::ops
