#pragma once

#include <cassert>
#include <cstddef>
#include <vector>

namespace slide {

/// An image in memory: height × width × channels of float32, row-major, channels interleaved.
/// Colours are sRGB-encoded values as stored in the file, 0 = black and 1 = full; maps (disparity, alpha,
/// ...) have one channel. Values outside [0, 1] are representable; whoever needs the range checks it. Pixel
/// (x, y) has its centre at integer coordinates (column, row). An image without pixels (width or height 0) is
/// "empty" and stands for "not given".
struct Image {
  int width = 0;
  int height = 0;
  int channels = 0;
  std::vector<float> data;  ///< height · width · channels values

  Image() = default;
  /// A width × height image with every value `fill`.
  Image(int width_, int height_, int channels_, float fill = 0.0F)
      : width(width_),
        height(height_),
        channels(channels_),
        data(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_) *
                 static_cast<std::size_t>(channels_),
             fill) {}

  [[nodiscard]] bool empty() const noexcept { return width == 0 || height == 0; }
  [[nodiscard]] std::size_t pixels() const noexcept {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  }
  /// Where channel c of pixel (x, y) lies in `data`.
  [[nodiscard]] std::size_t index(int x, int y, int c = 0) const noexcept {
    assert(x >= 0 && x < width && y >= 0 && y < height && c >= 0 && c < channels);
    return (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)) *
               static_cast<std::size_t>(channels) +
           static_cast<std::size_t>(c);
  }
  [[nodiscard]] float& at(int x, int y, int c = 0) noexcept { return data[index(x, y, c)]; }
  [[nodiscard]] float at(int x, int y, int c = 0) const noexcept { return data[index(x, y, c)]; }
  [[nodiscard]] float* row(int y) noexcept { return data.data() + index(0, y); }
  [[nodiscard]] const float* row(int y) const noexcept { return data.data() + index(0, y); }
};

}  // namespace slide
