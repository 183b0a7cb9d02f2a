#pragma once

#include <vector>

#include "render/lanes.h"
#include "render/layers.h"

namespace slide {

/// A layer's colour and alpha, ready for bilinear filtering: four floats to a texel, the last row and column
/// repeated once so that every texel in the photo has a right and a lower neighbour.
class Texture {
 public:
  explicit Texture(const Layer& layer);

  /// The largest texture coordinates: W - 1 and H - 1.
  [[nodiscard]] float right() const noexcept { return right_; }
  [[nodiscard]] float bottom() const noexcept { return bottom_; }

  /// Colour and alpha at (u, v) in [0, right] × [0, bottom], bilinear between the four nearest pixel centres.
  [[nodiscard]] Float4 sample(float u, float v) const noexcept {
    const auto x = static_cast<int>(u);
    const auto y = static_cast<int>(v);
    const Float4 fx = splat(u - static_cast<float>(x));
    const Float4 fy = splat(v - static_cast<float>(y));
    const float* const upper =
        texels_.data() + 4 * (static_cast<std::size_t>(y) * stride_ + static_cast<std::size_t>(x));
    const float* const lower = upper + 4 * stride_;
    const Float4 u0 = load4(upper);
    const Float4 l0 = load4(lower);
    const Float4 above = u0 + fx * (load4(upper + 4) - u0);
    const Float4 below = l0 + fx * (load4(lower + 4) - l0);
    return above + fy * (below - above);
  }

 private:
  std::size_t stride_;  ///< texels to a row
  float right_;
  float bottom_;
  std::vector<float> texels_;
};

}  // namespace slide
