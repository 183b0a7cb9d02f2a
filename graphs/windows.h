#pragma once

#include <cstdint>
#include <vector>

#include "runtime/tensor.h"

namespace slide::graphs {

/// A rectangle of pixels: x0 <= x < x1, y0 <= y < y1.
struct Window {
  std::int64_t x0, y0, x1, y1;
  [[nodiscard]] std::int64_t width() const noexcept { return x1 - x0; }
  [[nodiscard]] std::int64_t height() const noexcept { return y1 - y0; }
  [[nodiscard]] std::int64_t area() const noexcept { return width() * height(); }
  [[nodiscard]] bool overlaps(const Window& other) const noexcept {
    return x0 < other.x1 && other.x0 < x1 && y0 < other.y1 && other.y0 < y1;
  }
  friend bool operator==(const Window&, const Window&) = default;
};

/// The windows an inpainting network has to see: the bounding box of every connected region of the hole (8
/// neighbours), grown by `margin` on all sides, its corners moved outwards to multiples of `alignment`, cut
/// at the image's border, and merged into one as long as two of them overlap. Sorted from top to bottom, left
/// to right. With the network's receptive radius as margin and its stride as alignment, the network computes
/// in the windows exactly what it computes there on the whole image.
/// @param hole  1×1×H×W, F32, not 0 inside the hole
[[nodiscard]] std::vector<Window> hole_windows(const Tensor& hole, std::int64_t margin,
                                               std::int64_t alignment);

/// Copies a window of every plane of N×C×H×W (F32) into a tensor of its own.
[[nodiscard]] Tensor cut(const Tensor& image, const Window& window);

/// Copies a window's tensor back into its place.
void paste(const Tensor& part, const Window& window, Tensor& image);

}  // namespace slide::graphs
