#include "benchmarks/eval/plane.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "runtime/threads.h"

namespace slide::eval {
namespace {

/// Calls f(x, y) for every pixel, rows split among threads.
template <typename F>
void for_each_pixel(const Plane& p, const F& f) {
  parallel_for(p.height, [&](std::int64_t row) {
    const int y = static_cast<int>(row);
    for (int x = 0; x < p.width; ++x) f(x, y);
  });
}

}  // namespace

Plane luma(const Image& image) {
  Plane out(image.width, image.height);
  for_each_pixel(out, [&](int x, int y) {
    const auto value = [&](int c) { return std::clamp(static_cast<double>(image.at(x, y, c)), 0.0, 1.0); };
    out.at(x, y) = 0.299 * value(0) + 0.587 * value(1) + 0.114 * value(2);
  });
  return out;
}

Plane plane(const Image& image, int channel) {
  Plane out(image.width, image.height);
  for_each_pixel(out, [&](int x, int y) { out.at(x, y) = static_cast<double>(image.at(x, y, channel)); });
  return out;
}

Plane filtered(const Plane& p, const std::vector<double>& rows, const std::vector<double>& columns,
               Border border) {
  /// The sum over the taps; `value(i)` is the i-th pixel of n along the line.
  const auto line = [&](const std::vector<double>& taps, int at, int n, const auto& value) {
    const int radius = static_cast<int>(taps.size() / 2);
    double sum = 0;
    for (int i = -radius; i <= radius; ++i) {
      if (border == Border::kZero && (at + i < 0 || at + i >= n)) continue;
      sum += taps[static_cast<std::size_t>(i + radius)] * value(std::clamp(at + i, 0, n - 1));
    }
    return sum;
  };
  Plane half(p.width, p.height);
  for_each_pixel(
      half, [&](int x, int y) { half.at(x, y) = line(rows, x, p.width, [&](int i) { return p.at(i, y); }); });
  Plane out(p.width, p.height);
  for_each_pixel(out, [&](int x, int y) {
    out.at(x, y) = line(columns, y, p.height, [&](int i) { return half.at(x, i); });
  });
  return out;
}

Plane halved(const Plane& p) {
  Plane out((p.width + 1) / 2, (p.height + 1) / 2);
  for_each_pixel(out, [&](int x, int y) {
    const int right = std::min(2 * x + 1, p.width - 1);
    const int below = std::min(2 * y + 1, p.height - 1);
    out.at(x, y) = (p.at(2 * x, 2 * y) + p.at(right, 2 * y) + p.at(2 * x, below) + p.at(right, below)) / 4;
  });
  return out;
}

Spread weighted(const Plane& values, const Plane& weights) {
  double sum = 0;
  double weight = 0;
  for (std::size_t i = 0; i < values.data.size(); ++i) {
    sum += weights.data[i] > 0 ? weights.data[i] * values.data[i] : 0;
    weight += weights.data[i];
  }
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  if (!(weight > 0)) return {kNone, kNone};
  const double mean = sum / weight;
  double squares = 0;
  for (std::size_t i = 0; i < values.data.size(); ++i)
    if (weights.data[i] > 0) squares += weights.data[i] * (values.data[i] - mean) * (values.data[i] - mean);
  return {mean, std::sqrt(squares / weight)};
}

}  // namespace slide::eval
