#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "ops/common/elements.h"
#include "ops/layering/layering.h"
#include "ops/layering/layering_ops.h"

namespace slide::ops {
namespace {

double larger(double a, double b) { return std::isnan(a) || a > b ? a : b; }

/// max over i in the window of f(x(i), K(i)) for every pixel.
template <typename F>
void dilate(const Tensor& input, Tensor& output, std::int64_t radius, F f) {
  const Nchw in = nchw(input.shape());
  for_ranges(in.n * in.c * in.h, 4, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t line = begin; line < end; ++line) {
      const std::int64_t i = line % in.h;
      const double* plane = f64(input) + line / in.h * in.plane();
      double* y = f64(output) + line * in.w;
      const std::int64_t top = -std::min(radius, i);
      const std::int64_t bottom = std::min(radius, in.h - 1 - i);
      for (std::int64_t j = 0; j < in.w; ++j) {
        double best = -std::numeric_limits<double>::infinity();
        for (std::int64_t k = top; k <= bottom; ++k)
          best = larger(best, f(plane[(i + k) * in.w + j], static_cast<double>(std::abs(k))));
        const std::int64_t left = -std::min(radius, j);
        const std::int64_t right = std::min(radius, in.w - 1 - j);
        for (std::int64_t k = left; k <= right; ++k)
          best = larger(best, f(plane[i * in.w + j + k], static_cast<double>(std::abs(k))));
        y[j] = best;
      }
    }
  });
}

}  // namespace

std::string ConeDilationOp::attributes() const {
  return "rho " + number_text(rho_) + " radius " + std::to_string(radius_);
}

Shape ConeDilationOp::infer(std::span<const Shape> inputs) const {
  require_input_count("cone_dilation", inputs, 1, 1);
  const Nchw in = nchw(inputs[0]);
  require(rho_ >= 0 && rho_ <= std::numeric_limits<float>::max(), "rho is " + number_text(rho_));
  require_at_least("radius", radius_, 0);
  require(std::max(in.h, in.w) <= std::int64_t{1} << 24, "the image " + inputs[0].text() + " is too large");
  return inputs[0];
}

void ConeDilationOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  dilate(inputs[0], output, radius_, [this](double x, double distance) { return x - rho_ * distance; });
}

/// The largest |x| in the window. A pixel i can win only if rho·K(i) <= x(i) - x(p), so all terms of the
/// values that matter are within twice that.
void ConeDilationOp::error_scale(std::span<const Tensor> inputs, const Tensor& /*output*/,
                                 Tensor& scale) const {
  dilate(inputs[0], scale, radius_, [](double x, double) { return std::fabs(x); });
}

Value cone_dilation(Value x, double rho, std::int64_t radius) {
  return x.graph().add(std::make_shared<ConeDilationOp>(rho, radius), {x});
}

}  // namespace slide::ops
