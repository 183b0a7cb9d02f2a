#include "ops/guided/guided.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "ops/common/elements.h"
#include "ops/guided/guided_op.h"
#include "ops/pointwise/pointwise.h"
#include "ops/resize/resize.h"
#include "ops/tensor_shape/tensor_shape.h"

namespace slide::ops {
namespace {

/// The pixels within a radius of (i, j).
struct Window {
  std::int64_t top, bottom, left, right;  // ends excluded

  Window(const Nchw& s, std::int64_t i, std::int64_t j, std::int64_t radius)
      : top(i - std::min(i, radius)),
        bottom(i + 1 + std::min(s.h - 1 - i, radius)),
        left(j - std::min(j, radius)),
        right(j + 1 + std::min(s.w - 1 - j, radius)) {}

  /// The mean of f(pixel) over the window of a picture `width` pixels wide.
  template <typename F>
  [[nodiscard]] double mean(std::int64_t width, F f) const {
    double sum = 0;
    for (std::int64_t y = top; y < bottom; ++y)
      for (std::int64_t x = left; x < right; ++x) sum += f(y * width + x);
    return sum / static_cast<double>((bottom - top) * (right - left));
  }
};

/// a and b of one window, into planes `stride` apart.
void fit(const double* guide, const double* x, const Nchw& s, const Window& window, double eps, double* out) {
  const auto count = static_cast<std::size_t>(s.c);
  const std::int64_t plane = s.plane();
  const auto g = [&](std::size_t c, std::int64_t p) {
    return guide[static_cast<std::int64_t>(c) * plane + p];
  };
  const double mean_x = window.mean(s.w, [&](std::int64_t p) { return x[p]; });
  std::array<double, kMostGuidePlanes> mean{};
  SmallSystem system{{}, {}, count};
  for (std::size_t c = 0; c < count; ++c) {
    mean[c] = window.mean(s.w, [&](std::int64_t p) { return g(c, p); });
    system.vector[c] =
        window.mean(s.w, [&](std::int64_t p) { return (g(c, p) - mean[c]) * (x[p] - mean_x); });
    for (std::size_t d = 0; d <= c; ++d)
      system.matrix[c * count + d] =
          window.mean(s.w, [&](std::int64_t p) { return (g(c, p) - mean[c]) * (g(d, p) - mean[d]); });
    system.matrix[c * count + c] += eps;
  }
  system.solve();
  double b = mean_x;
  for (std::size_t c = 0; c < count; ++c) {
    out[static_cast<std::int64_t>(c) * plane] = system.vector[c];
    b -= system.vector[c] * mean[c];
  }
  out[s.c * plane] = b;
}

}  // namespace

void SmallSystem::solve() {
  const std::size_t n = count;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      double sum = matrix[i * n + j];
      for (std::size_t k = 0; k < j; ++k) sum -= matrix[i * n + k] * matrix[j * n + k];
      matrix[i * n + j] = i == j ? std::sqrt(sum) : sum / matrix[j * n + j];
    }
    double sum = vector[i];
    for (std::size_t k = 0; k < i; ++k) sum -= matrix[i * n + k] * vector[k];
    vector[i] = sum / matrix[i * n + i];
  }
  for (std::size_t i = n; i-- > 0;) {
    double sum = vector[i];
    for (std::size_t k = i + 1; k < n; ++k) sum -= matrix[k * n + i] * vector[k];
    vector[i] = sum / matrix[i * n + i];
  }
}

std::string GuidedCoefficientsOp::attributes() const {
  return "radius " + std::to_string(radius_) + " eps " + number_text(eps_);
}

Shape GuidedCoefficientsOp::infer(std::span<const Shape> inputs) const {
  require_input_count("guided_coefficients", inputs, 2, 2);
  const Nchw guide = nchw(inputs[0]);
  require(guide.c <= kMostGuidePlanes,
          "the guide " + inputs[0].text() + " has more than " + std::to_string(kMostGuidePlanes) + " planes");
  require(inputs[1] == inputs[0].with(1, 1),
          "what is filtered is " + inputs[1].text() + ", the guide " + inputs[0].text());
  require(radius_ >= 0, "the radius is negative");
  require(eps_ > 0 && std::isfinite(eps_), "eps is not positive");
  return inputs[0].with(1, guide.c + 1);
}

void GuidedCoefficientsOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const Nchw s = nchw(inputs[0].shape());
  const std::int64_t planes = s.c + 1;
  std::vector<double> fitted(static_cast<std::size_t>(s.n * planes * s.plane()));
  for_ranges(s.n * s.h, 1, [&](std::int64_t row, std::int64_t) {
    const std::int64_t n = row / s.h;
    for (std::int64_t j = 0; j < s.w; ++j)
      fit(f64(inputs[0]) + n * s.c * s.plane(), f64(inputs[1]) + n * s.plane(), s,
          Window(s, row % s.h, j, radius_), eps_,
          fitted.data() + n * planes * s.plane() + row % s.h * s.w + j);
  });
  for_ranges(s.n * planes * s.h, 1, [&](std::int64_t row, std::int64_t) {
    const double* plane = fitted.data() + row / s.h * s.plane();
    for (std::int64_t j = 0; j < s.w; ++j)
      f64(output)[row * s.w + j] =
          Window(s, row % s.h, j, radius_).mean(s.w, [&](std::int64_t p) { return plane[p]; });
  });
}

void GuidedCoefficientsOp::error_scale(std::span<const Tensor> inputs, const Tensor& output,
                                       Tensor& scale) const {
  const Nchw s = nchw(inputs[0].shape());
  const auto largest = [](const double* begin, std::int64_t count) {
    return std::accumulate(begin, begin + count, 0.0,
                           [](double m, double v) { return std::max(m, std::fabs(v)); });
  };
  const auto extent = [&](std::int64_t size) {
    return static_cast<double>(std::min(size, 2 * std::min(size, radius_) + 1));
  };
  const auto c = static_cast<double>(s.c);
  const double k = 6 * c * (7 * extent(s.h) * extent(s.w) + 30 + c * (3 * c + 1));
  for (std::int64_t n = 0; n < s.n; ++n) {
    const double g = largest(f64(inputs[0]) + n * s.c * s.plane(), s.c * s.plane());
    const double p = largest(f64(inputs[1]) + n * s.plane(), s.plane());
    const double a = p / (2 * std::sqrt(eps_));
    for (std::int64_t plane = n * (s.c + 1); plane < (n + 1) * (s.c + 1); ++plane) {
      const double most = plane % (s.c + 1) < s.c ? a : p + c * g * a;
      for (std::int64_t i = plane * s.plane(); i < (plane + 1) * s.plane(); ++i)
        f64(scale)[i] = std::fabs(f64(output)[i]) + 0x1p-29 * k * (1 + g * g / eps_) * most;
    }
  }
}

Value guided_coefficients(Value guide, Value x, std::int64_t radius, double eps) {
  return x.graph().add(std::make_shared<GuidedCoefficientsOp>(radius, eps), {guide, x});
}

Value guided_upsample(Value x, Value small_guide, Value guide, std::int64_t radius, double eps) {
  const std::int64_t planes = guide.shape()[1];
  const Value coefficients = guided_coefficients(small_guide, x, radius, eps);
  const auto enlarged = [&](std::int64_t c) {  // one plane at a time: little memory
    return resize_bilinear(slice(coefficients, 1, c, c + 1), guide.shape()[2], guide.shape()[3], false);
  };
  Value sum = enlarged(planes);
  for (std::int64_t c = 0; c < planes; ++c) sum = add(sum, mul(enlarged(c), slice(guide, 1, c, c + 1)));
  return sum;
}

}  // namespace slide::ops
