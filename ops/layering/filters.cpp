#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "ops/common/elements.h"
#include "ops/layering/layering.h"
#include "ops/layering/layering_ops.h"

namespace slide::ops {
namespace {

constexpr double kLargestSigma = 1e4;

/// The pixel of a plane at (row, column), the border replicated.
double replicated(const double* plane, const Nchw& in, std::int64_t row, std::int64_t column) {
  return plane[std::clamp<std::int64_t>(row, 0, in.h - 1) * in.w +
               std::clamp<std::int64_t>(column, 0, in.w - 1)];
}

/// The Gaussian of f(x): along columns, then along rows.
template <typename F>
void blur(const std::vector<double>& taps, const Tensor& input, Tensor& output, F f) {
  const Nchw in = nchw(input.shape());
  const std::int64_t radius = static_cast<std::int64_t>(taps.size()) - 1;
  const auto tap = [&](std::int64_t k) { return taps[static_cast<std::size_t>(std::abs(k))]; };
  for_ranges(in.n * in.c, 1, [&](std::int64_t p, std::int64_t) {
    const double* x = f64(input) + p * in.plane();
    double* y = f64(output) + p * in.plane();
    std::vector<double> vertical(static_cast<std::size_t>(in.plane()), 0.0);
    for (std::int64_t i = 0; i < in.h; ++i)
      for (std::int64_t k = -radius; k <= radius; ++k)
        for (std::int64_t j = 0; j < in.w; ++j)
          vertical[static_cast<std::size_t>(i * in.w + j)] += tap(k) * f(replicated(x, in, i + k, j));
    for (std::int64_t i = 0; i < in.h; ++i)
      for (std::int64_t j = 0; j < in.w; ++j) {
        double sum = 0;
        for (std::int64_t k = -radius; k <= radius; ++k)
          sum += tap(k) * replicated(vertical.data(), in, i, j + k);
        y[i * in.w + j] = sum;
      }
  });
}

/// gx and gy with the given values for the weights -1 and for f(x): signs kept or dropped.
template <typename F>
void gradients(const Tensor& input, Tensor& output, double minus, F f) {
  const Nchw in = nchw(input.shape());
  constexpr double kSmooth[] = {1, 2, 1};
  const double slope[] = {minus, 0, 1};
  for_ranges(in.n * in.h, 8, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t line = begin; line < end; ++line) {
      const std::int64_t n = line / in.h;
      const std::int64_t i = line % in.h;
      const double* x = f64(input) + n * in.plane();
      double* y = f64(output) + 2 * n * in.plane();
      for (std::int64_t j = 0; j < in.w; ++j) {
        double gx = 0;
        double gy = 0;
        for (int u = 0; u < 3; ++u)
          for (int v = 0; v < 3; ++v) {
            const double value = f(replicated(x, in, i + u - 1, j + v - 1));
            if (slope[v] != 0) gx += kSmooth[u] * slope[v] * value;  // nothing of a NaN that has no weight
            if (slope[u] != 0) gy += slope[u] * kSmooth[v] * value;
          }
        y[i * in.w + j] = gx / 8;
        y[in.plane() + i * in.w + j] = gy / 8;
      }
    }
  });
}

}  // namespace

std::vector<double> GaussianBlurOp::taps() const {
  std::vector<double> taps{1.0};
  const auto radius = static_cast<std::int64_t>(std::ceil(3 * sigma_));
  double sum = 1;
  for (std::int64_t i = 1; i <= radius; ++i) {
    const double distance = static_cast<double>(i) / sigma_;
    taps.push_back(std::exp(-distance * distance / 2));
    sum += 2 * taps.back();
  }
  for (double& tap : taps) tap /= sum;
  return taps;
}

std::string GaussianBlurOp::attributes() const { return "sigma " + number_text(sigma_); }

Shape GaussianBlurOp::infer(std::span<const Shape> inputs) const {
  require_input_count("gaussian_blur", inputs, 1, 1);
  static_cast<void>(nchw(inputs[0]));
  require(sigma_ >= 0 && sigma_ <= kLargestSigma,
          "sigma is " + number_text(sigma_) + ", it must lie between 0 and " + number_text(kLargestSigma));
  return inputs[0];
}

void GaussianBlurOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  blur(taps(), inputs[0], output, [](double v) { return v; });
}

/// The blur of |x|.
void GaussianBlurOp::error_scale(std::span<const Tensor> inputs, const Tensor& /*output*/,
                                 Tensor& scale) const {
  blur(taps(), inputs[0], scale, [](double v) { return std::fabs(v); });
}

double GaussianBlurOp::macs(std::span<const Shape> /*inputs*/, const Shape& output) const {
  return 2 * (2 * std::ceil(3 * sigma_) + 1) * static_cast<double>(output.count());
}

Shape SobelOp::infer(std::span<const Shape> inputs) const {
  require_input_count("sobel", inputs, 1, 1);
  const Nchw in = nchw(inputs[0]);
  require(in.c == 1, "sobel takes one channel and was given " + inputs[0].text());
  return {in.n, 2, in.h, in.w};
}

void SobelOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  gradients(inputs[0], output, -1, [](double v) { return v; });
}

/// The same weights, all positive, over |x|.
void SobelOp::error_scale(std::span<const Tensor> inputs, const Tensor& /*output*/, Tensor& scale) const {
  gradients(inputs[0], scale, 1, [](double v) { return std::fabs(v); });
}

Value gaussian_blur(Value x, double sigma) {
  return x.graph().add(std::make_shared<GaussianBlurOp>(sigma), {x});
}

Value sobel(Value x) { return x.graph().add(std::make_shared<SobelOp>(), {x}); }

}  // namespace slide::ops
