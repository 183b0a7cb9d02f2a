#include "graphs/windows.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "runtime/error.h"

namespace slide::graphs {
namespace {

/// A run of hole pixels in one row, and the region it belongs to.
struct Run {
  std::int64_t x0, x1;
  std::size_t region;
};

/// Regions found so far, joined by union-find; each root's box covers all its runs.
class Regions {
 public:
  std::size_t add(const Window& box) {
    parents_.push_back(parents_.size());
    boxes_.push_back(box);
    return parents_.size() - 1;
  }
  std::size_t root(std::size_t region) {
    while (parents_[region] != region) region = parents_[region] = parents_[parents_[region]];
    return region;
  }
  void join(std::size_t a, std::size_t b) {
    a = root(a);
    b = root(b);
    if (a == b) return;
    parents_[b] = a;
    const Window& other = boxes_[b];
    Window& box = boxes_[a];
    box = {std::min(box.x0, other.x0), std::min(box.y0, other.y0), std::max(box.x1, other.x1),
           std::max(box.y1, other.y1)};
  }
  std::vector<Window> boxes() {
    std::vector<Window> out;
    for (std::size_t i = 0; i < parents_.size(); ++i)
      if (root(i) == i) out.push_back(boxes_[i]);
    return out;
  }

 private:
  std::vector<std::size_t> parents_;
  std::vector<Window> boxes_;
};

std::vector<Window> region_boxes(const Tensor& hole) {
  const std::int64_t h = hole.shape()[2];
  const std::int64_t w = hole.shape()[3];
  const float* pixels = hole.data<float>().data();
  Regions regions;
  std::vector<Run> above;
  for (std::int64_t y = 0; y < h; ++y) {
    std::vector<Run> row;
    for (std::int64_t x = 0; x < w; ++x) {
      if (pixels[y * w + x] == 0) continue;
      const std::int64_t x0 = x;
      while (x < w && pixels[y * w + x] != 0) ++x;
      row.push_back({x0, x, regions.add({x0, y, x, y + 1})});
      for (const Run& run : above)
        if (run.x0 <= x && x0 <= run.x1) regions.join(run.region, row.back().region);  // diagonals touch
    }
    above = std::move(row);
  }
  return regions.boxes();
}

Window grow(const Window& box, std::int64_t margin, std::int64_t alignment, std::int64_t w, std::int64_t h) {
  const auto down = [&](std::int64_t v) {
    return std::max<std::int64_t>(0, (v - margin)) / alignment * alignment;
  };
  const auto up = [&](std::int64_t v, std::int64_t limit) {
    return std::min(limit, (v + margin + alignment - 1) / alignment * alignment);
  };
  return {down(box.x0), down(box.y0), up(box.x1, w), up(box.y1, h)};
}

/// Replaces overlapping windows by their common box until no two overlap.
void merge_overlapping(std::vector<Window>& windows) {
  for (bool merged = true; std::exchange(merged, false);) {
    for (std::size_t i = 0; i < windows.size(); ++i)
      for (std::size_t j = i + 1; j < windows.size();) {
        if (!windows[i].overlaps(windows[j])) {
          ++j;
          continue;
        }
        Window& a = windows[i];
        const Window& b = windows[j];
        a = {std::min(a.x0, b.x0), std::min(a.y0, b.y0), std::max(a.x1, b.x1), std::max(a.y1, b.y1)};
        windows.erase(windows.begin() + static_cast<std::ptrdiff_t>(j));
        merged = true;
      }
  }
}

void require_planes(const Tensor& t) {
  if (t.shape().rank() != 4)
    throw Error(ErrorKind::kInternal, "windows are cut from tensors of rank 4, not " + t.shape().text());
}

/// Calls copy(offset in the image, offset in the part, floats) for every row of the window.
template <typename Copy>
void for_each_row(const Shape& image, const Window& window, const Copy& copy) {
  if (window.x0 < 0 || window.y0 < 0 || window.x1 > image[3] || window.y1 > image[2] || window.width() < 1 ||
      window.height() < 1)
    throw Error(ErrorKind::kInternal, "a window exceeds its image of shape " + image.text());
  for (std::int64_t plane = 0; plane < image[0] * image[1]; ++plane)
    for (std::int64_t y = 0; y < window.height(); ++y)
      copy((plane * image[2] + window.y0 + y) * image[3] + window.x0,
           (plane * window.height() + y) * window.width(),
           static_cast<std::size_t>(window.width()) * sizeof(float));
}

}  // namespace

std::vector<Window> hole_windows(const Tensor& hole, std::int64_t margin, std::int64_t alignment) {
  require_planes(hole);
  if (margin < 0 || alignment < 1)
    throw Error(ErrorKind::kInternal, "hole windows need a margin >= 0 and an alignment >= 1");
  std::vector<Window> windows;
  for (const Window& box : region_boxes(hole))
    windows.push_back(grow(box, margin, alignment, hole.shape()[3], hole.shape()[2]));
  merge_overlapping(windows);
  std::sort(windows.begin(), windows.end(),
            [](const Window& a, const Window& b) { return std::pair(a.y0, a.x0) < std::pair(b.y0, b.x0); });
  return windows;
}

Tensor cut(const Tensor& image, const Window& window) {
  require_planes(image);
  const Shape& s = image.shape();
  Tensor part(DType::kF32, {s[0], s[1], window.height(), window.width()});
  const float* from = image.data<float>().data();
  float* to = part.mutable_data<float>().data();
  for_each_row(s, window, [&](std::int64_t at, std::int64_t part_at, std::size_t bytes) {
    std::memcpy(to + part_at, from + at, bytes);
  });
  return part;
}

void paste(const Tensor& part, const Window& window, Tensor& image) {
  require_planes(image);
  const Shape wanted({image.shape()[0], image.shape()[1], window.height(), window.width()});
  if (part.shape() != wanted)
    throw Error(ErrorKind::kInternal,
                "a part of shape " + part.shape().text() + " for a window of " + wanted.text());
  const float* from = part.data<float>().data();
  float* to = image.mutable_data<float>().data();
  for_each_row(image.shape(), window, [&](std::int64_t at, std::int64_t part_at, std::size_t bytes) {
    std::memcpy(to + at, from + part_at, bytes);
  });
}

}  // namespace slide::graphs
