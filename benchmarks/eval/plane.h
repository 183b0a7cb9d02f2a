#pragma once

#include <cstddef>
#include <vector>

#include "render/image.h"

namespace slide::eval {

/// One value per pixel in float64, row-major.
struct Plane {
  int width = 0;
  int height = 0;
  std::vector<double> data;

  Plane() = default;
  Plane(int width_, int height_, double fill = 0)
      : width(width_),
        height(height_),
        data(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_), fill) {}
  [[nodiscard]] std::size_t index(int x, int y) const noexcept {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
  }
  [[nodiscard]] double& at(int x, int y) noexcept { return data[index(x, y)]; }
  [[nodiscard]] double at(int x, int y) const noexcept { return data[index(x, y)]; }
};

/// BT.601 luma of sRGB values clamped to [0, 1].
[[nodiscard]] Plane luma(const Image& image);

/// One channel of an image, as it is.
[[nodiscard]] Plane plane(const Image& image, int channel = 0);

/// f of each pixel of two planes of one size.
template <typename F>
Plane combined(const Plane& a, const Plane& b, F f) {
  Plane out(a.width, a.height);
  for (std::size_t i = 0; i < out.data.size(); ++i) out.data[i] = f(a.data[i], b.data[i]);
  return out;
}

/// What lies beyond the picture.
enum class Border { kZero, kRepeated };

/// The sum over i and j of columns[j]·rows[i]·p(x + i - r, y + j - r); both of 2r + 1 taps.
[[nodiscard]] Plane filtered(const Plane& p, const std::vector<double>& rows,
                             const std::vector<double>& columns, Border border);

/// The means of 2×2 pixels, the last row and column repeated where there is an odd number of them.
[[nodiscard]] Plane halved(const Plane& p);

/// Weighted mean and standard deviation; NaN where no weight is positive.
struct Spread {
  double mean, deviation;
};
[[nodiscard]] Spread weighted(const Plane& values, const Plane& weights);

}  // namespace slide::eval
