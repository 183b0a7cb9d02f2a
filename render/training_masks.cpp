#include "render/training_masks.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace slide {
namespace {

/// SplitMix64 (Steele, Lea, Flood, OOPSLA 2014): the same numbers with every standard library.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  /// In [0, 1).
  double unit() {
    std::uint64_t z = (state_ += 0x9E3779B97F4A7C15U);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBU;
    return static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1p-53;
  }
  double between(double low, double high) { return low + (high - low) * unit(); }
  /// In [low, high].
  int integer(int low, int high) { return low + static_cast<int>(unit() * (high - low + 1)); }
  /// About normal: the sum of twelve uniforms.
  double normal(double mean, double deviation) {
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += unit();
    return mean + deviation * sum;
  }

 private:
  std::uint64_t state_;
};

struct Point {
  double x, y;
};

/// A line from a to b with round ends.
void draw_line(Point a, Point b, double width, Image& mask) {
  const double r = width / 2;
  const auto low = [&](double v) { return std::max(0, static_cast<int>(std::ceil(v - r))); };
  const int x1 = std::min(mask.width - 1, static_cast<int>(std::floor(std::max(a.x, b.x) + r)));
  const int y1 = std::min(mask.height - 1, static_cast<int>(std::floor(std::max(a.y, b.y) + r)));
  const double dx = b.x - a.x;
  const double dy = b.y - a.y;
  const double length2 = std::max(1e-12, dx * dx + dy * dy);
  for (int y = low(std::min(a.y, b.y)); y <= y1; ++y)
    for (int x = low(std::min(a.x, b.x)); x <= x1; ++x) {
      const double t = std::clamp(((x - a.x) * dx + (y - a.y) * dy) / length2, 0.0, 1.0);
      if (std::hypot(x - a.x - t * dx, y - a.y - t * dy) <= r) mask.at(x, y) = 1;
    }
}

void draw_stroke(Random& random, Image& mask) {
  const double scale = std::min(mask.width, mask.height) / 256.0;
  const double radius = std::hypot(mask.width, mask.height) / 8;
  const double turn = 2 * std::numbers::pi / 5;
  const double spread = 2 * std::numbers::pi / 15;
  const double width = random.between(12, 40) * scale;
  const int vertices = random.integer(4, 12);
  Point at{random.unit() * mask.width, random.unit() * mask.height};
  for (int i = 0; i < vertices; ++i) {
    const double angle = random.between(turn - spread, turn + spread);
    const double direction = i % 2 == 0 ? 2 * std::numbers::pi - angle : angle;
    const double length = std::clamp(random.normal(radius, radius / 2), 0.0, 2 * radius);
    const Point to{std::clamp(at.x + length * std::cos(direction), 0.0, mask.width - 1.0),
                   std::clamp(at.y + length * std::sin(direction), 0.0, mask.height - 1.0)};
    draw_line(at, to, width, mask);
    at = to;
  }
}

void flip_columns(Image& mask) {
  for (int y = 0; y < mask.height; ++y) std::reverse(mask.row(y), mask.row(y) + mask.width);
}

void flip_rows(Image& mask) {
  for (int y = 0; y < mask.height / 2; ++y)
    std::swap_ranges(mask.row(y), mask.row(y) + mask.width, mask.row(mask.height - 1 - y));
}

}  // namespace

Image occlusion_mask(const Image& occlusion) {
  Image mask(occlusion.width, occlusion.height, 1);
  std::transform(occlusion.data.begin(), occlusion.data.end(), mask.data.begin(),
                 [](float s) { return s > 0.05F ? 1.0F : 0.0F; });
  return mask;
}

Image stroke_mask(int width, int height, std::uint64_t seed) {
  Random random(seed);
  Image mask(width, height, 1);
  const int strokes = random.integer(1, 4);
  for (int i = 0; i < strokes; ++i) draw_stroke(random, mask);
  if (random.unit() < 0.5) flip_columns(mask);
  if (random.unit() < 0.5) flip_rows(mask);
  return mask;
}

}  // namespace slide
