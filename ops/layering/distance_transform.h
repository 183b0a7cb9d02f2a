#pragma once

#include "runtime/graph.h"
#include "runtime/op.h"

namespace slide::ops {

/// Squared Euclidean distance transform of each plane of N×C×H×W: y(p) = the least |p - q|² over the pixels q
/// of the same plane with x(q) > 0.5, distances in pixels; 0 at such a pixel itself. Infinity everywhere in a
/// plane that has none. NaN in x is not above 0.5. Sides up to 2^24 pixels.
///
/// The kernel works in integers and is exact where the largest distance that the plane's size allows, (H-1)²
/// + (W-1)², is at most 2^24 (a diagonal of 4096 pixels); beyond that it rounds the exact number once.
/// O(pixels).
Value distance_transform(Value x);

/// distance_transform().
class DistanceTransformOp : public Op {
 public:
  [[nodiscard]] std::string_view type() const override { return "distance_transform"; }
  [[nodiscard]] Shape infer(std::span<const Shape> inputs) const override;
  void reference(std::span<const Tensor> inputs, Tensor& output) const override;
  [[nodiscard]] std::span<const Kernel* const> kernels() const override;
};

}  // namespace slide::ops
