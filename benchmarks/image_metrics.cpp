#include "benchmarks/image_metrics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "runtime/threads.h"

namespace slide {
namespace {

constexpr int kRadius = 5;

double clamped(float v) { return std::clamp(static_cast<double>(v), 0.0, 1.0); }

double luma(const Image& image, int x, int y) {
  return 0.299 * clamped(image.at(x, y, 0)) + 0.587 * clamped(image.at(x, y, 1)) +
         0.114 * clamped(image.at(x, y, 2));
}

std::array<double, 2 * kRadius + 1> window() {
  std::array<double, 2 * kRadius + 1> taps{};
  for (int i = -kRadius; i <= kRadius; ++i)
    taps[static_cast<std::size_t>(i + kRadius)] = std::exp(-i * i / (2 * 1.5 * 1.5));
  return taps;
}

double ssim_at(const Image& a, const Image& b, int x, int y) {
  static const auto kTaps = window();
  double sum = 0, ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
  for (int v = std::max(0, y - kRadius); v <= std::min(a.height - 1, y + kRadius); ++v)
    for (int u = std::max(0, x - kRadius); u <= std::min(a.width - 1, x + kRadius); ++u) {
      const double w =
          kTaps[static_cast<std::size_t>(v - y + kRadius)] * kTaps[static_cast<std::size_t>(u - x + kRadius)];
      const double p = luma(a, u, v);
      const double q = luma(b, u, v);
      sum += w;
      ma += w * p;
      mb += w * q;
      aa += w * p * p;
      bb += w * q * q;
      ab += w * p * q;
    }
  ma /= sum;
  mb /= sum;
  const double variance_a = aa / sum - ma * ma;
  const double variance_b = bb / sum - mb * mb;
  const double covariance = ab / sum - ma * mb;
  constexpr double kC1 = 0.01 * 0.01;
  constexpr double kC2 = 0.03 * 0.03;
  return (2 * ma * mb + kC1) * (2 * covariance + kC2) /
         ((ma * ma + mb * mb + kC1) * (variance_a + variance_b + kC2));
}

/// The mean of f over the masked pixels, row by row so that the order of the sum does not depend on threads.
template <typename F>
double masked_mean(const Image& mask, F f) {
  std::vector<double> sums(static_cast<std::size_t>(mask.height));
  std::vector<double> counts(sums.size());
  parallel_for(mask.height, [&](std::int64_t row) {
    const int y = static_cast<int>(row);
    for (int x = 0; x < mask.width; ++x) {
      if (!(mask.at(x, y) > 0)) continue;
      sums[static_cast<std::size_t>(y)] += f(x, y);
      counts[static_cast<std::size_t>(y)] += 1;
    }
  });
  double sum = 0, count = 0;
  for (std::size_t y = 0; y < sums.size(); ++y) {
    sum += sums[y];
    count += counts[y];
  }
  return count > 0 ? sum / count : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

double psnr(const Image& a, const Image& b, const Image& mask) {
  const double mse = masked_mean(mask, [&](int x, int y) {
    double sum = 0;
    for (int c = 0; c < a.channels; ++c) {
      const double e = clamped(a.at(x, y, c)) - clamped(b.at(x, y, c));
      sum += e * e;
    }
    return sum / a.channels;
  });
  return -10 * std::log10(mse);
}

double ssim(const Image& a, const Image& b, const Image& mask) {
  return masked_mean(mask, [&](int x, int y) { return ssim_at(a, b, x, y); });
}

Image without_border(const Image& mask, double part) {
  Image out(mask.width, mask.height, 1);
  const int left = static_cast<int>(std::lround(part * mask.width));
  const int top = static_cast<int>(std::lround(part * mask.height));
  for (int y = top; y < mask.height - top; ++y)
    for (int x = left; x < mask.width - left; ++x) out.at(x, y) = mask.at(x, y);
  return out;
}

double mask_fraction(const Image& mask) {
  double count = 0;
  for (const float v : mask.data) count += v > 0 ? 1 : 0;
  return count / static_cast<double>(mask.pixels());
}

}  // namespace slide
