#include "benchmarks/eval/image_metrics.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "benchmarks/eval/plane.h"

namespace slide::eval {
namespace {

constexpr int kRadius = 5;
constexpr double kSigma = 1.5;
constexpr double kC1 = 0.01 * 0.01;
constexpr double kC2 = 0.03 * 0.03;
constexpr std::array kScaleWeights = {0.0448, 0.2856, 0.3001, 0.2363, 0.1333};
constexpr double kGradientNoise = 170;

double clamped(float v) { return std::clamp(static_cast<double>(v), 0.0, 1.0); }

double product(double a, double b) { return a * b; }

/// Means over a Gaussian window that the picture's border cuts.
class WindowMean {
 public:
  WindowMean(int width, int height) : taps_(2 * kRadius + 1) {
    for (int i = -kRadius; i <= kRadius; ++i)
      taps_[static_cast<std::size_t>(i + kRadius)] = std::exp(-i * i / (2 * kSigma * kSigma));
    weight_ = filtered(Plane(width, height, 1), taps_, taps_, Border::kZero);
  }
  [[nodiscard]] Plane operator()(const Plane& p) const {
    return combined(filtered(p, taps_, taps_, Border::kZero), weight_,
                    [](double sum, double weight) { return sum / weight; });
  }

 private:
  std::vector<double> taps_;
  Plane weight_;
};

/// The two factors of SSIM.
struct Similarity {
  Plane luminance;           ///< l
  Plane contrast_structure;  ///< c·s
};

Similarity similarity(const Plane& a, const Plane& b) {
  const WindowMean mean(a.width, a.height);
  const Plane ma = mean(a);
  const Plane mb = mean(b);
  const Plane squares = combined(mean(combined(a, a, product)), mean(combined(b, b, product)),
                                 [](double x, double y) { return x + y; });
  const Plane products = mean(combined(a, b, product));
  Similarity out{Plane(a.width, a.height), Plane(a.width, a.height)};
  for (std::size_t i = 0; i < ma.data.size(); ++i) {
    const double x = ma.data[i];
    const double y = mb.data[i];
    out.luminance.data[i] = (2 * x * y + kC1) / (x * x + y * y + kC1);
    out.contrast_structure.data[i] =
        (2 * (products.data[i] - x * y) + kC2) / (squares.data[i] - x * x - y * y + kC2);
  }
  return out;
}

Plane gradient(const Plane& p) {
  const std::vector<double> difference = {-1, 0, 1};
  const std::vector<double> mean = {1.0 / 3, 1.0 / 3, 1.0 / 3};
  return combined(filtered(p, difference, mean, Border::kRepeated),
                  filtered(p, mean, difference, Border::kRepeated),
                  [](double x, double y) { return 255 * std::hypot(x, y); });
}

/// Rows and columns that without_border() takes off at each end.
struct Sides {
  int left, top;
};
Sides sides(const Image& image, double part) {
  return {static_cast<int>(std::lround(part * image.width)),
          static_cast<int>(std::lround(part * image.height))};
}

}  // namespace

double psnr(const Image& a, const Image& b, const Image& mask) {
  Plane errors(a.width, a.height);
  for (std::size_t i = 0; i < a.data.size(); ++i) {
    const double e = clamped(a.data[i]) - clamped(b.data[i]);
    errors.data[i / static_cast<std::size_t>(a.channels)] += e * e / a.channels;
  }
  return -10 * std::log10(weighted(errors, plane(mask)).mean);
}

double ssim(const Image& a, const Image& b, const Image& mask) {
  const Similarity s = similarity(luma(a), luma(b));
  return weighted(combined(s.luminance, s.contrast_structure, product), plane(mask)).mean;
}

double ms_ssim(const Image& a, const Image& b, const Image& mask) {
  Plane x = luma(a);
  Plane y = luma(b);
  Plane weights = plane(mask);
  double result = 1;
  for (std::size_t scale = 0; scale < kScaleWeights.size(); ++scale) {
    if (scale > 0) {
      x = halved(x);
      y = halved(y);
      weights = halved(weights);
    }
    const Similarity s = similarity(x, y);
    const bool last = scale + 1 == kScaleWeights.size();
    const double mean =
        weighted(last ? combined(s.luminance, s.contrast_structure, product) : s.contrast_structure, weights)
            .mean;
    result *= mean < 0 ? 0 : std::pow(mean, kScaleWeights[scale]);
  }
  return result;
}

double gmsd(const Image& a, const Image& b, const Image& mask, GradientScale scale) {
  const bool half = scale == GradientScale::kHalf;
  const auto sized = [half](const Plane& p) { return half ? halved(p) : p; };
  const Plane similarity = combined(
      gradient(sized(luma(a))), gradient(sized(luma(b))),
      [](double p, double q) { return (2 * p * q + kGradientNoise) / (p * p + q * q + kGradientNoise); });
  return weighted(similarity, sized(plane(mask))).deviation;
}

Image without_border(const Image& mask, double part) {
  Image out(mask.width, mask.height, 1);
  const Sides off = sides(mask, part);
  for (int y = off.top; y < mask.height - off.top; ++y)
    for (int x = off.left; x < mask.width - off.left; ++x) out.at(x, y) = mask.at(x, y);
  return out;
}

Image cropped(const Image& image, double part) {
  const Sides off = sides(image, part);
  Image out(image.width - 2 * off.left, image.height - 2 * off.top, image.channels);
  for (int y = 0; y < out.height; ++y)
    std::copy_n(image.data.data() + image.index(off.left, y + off.top), out.width * out.channels, out.row(y));
  return out;
}

double mask_fraction(const Image& mask) {
  double count = 0;
  for (const float v : mask.data) count += v > 0 ? 1 : 0;
  return count / static_cast<double>(mask.pixels());
}

}  // namespace slide::eval
