#include "ops/resize/resize.h"

#include <algorithm>
#include <cmath>

#include "ops/common/elements.h"
#include "ops/resize/resize_op.h"

namespace slide::ops {
namespace {

/// The input coordinate of output index i. `output` is the output extent, or input extent · scale where a
/// scale is given (then it need not be whole).
double coordinate(ResizeCoordinates rule, double i, double input, double output, std::int64_t output_size) {
  switch (rule) {
    case ResizeCoordinates::kHalfPixel:
      return (i + 0.5) * input / output - 0.5;
    case ResizeCoordinates::kPytorchHalfPixel:
      return output_size > 1 ? (i + 0.5) * input / output - 0.5 : 0;
    case ResizeCoordinates::kAlignCorners:
      return output_size > 1 ? i * (input - 1) / (output - 1) : 0;
    case ResizeCoordinates::kAsymmetric:
      return i * input / output;
  }
  return 0;
}

double round_nearest(NearestRounding rounding, double c) {
  switch (rounding) {
    case NearestRounding::kFloor:
      return std::floor(c);
    case NearestRounding::kCeil:
      return std::ceil(c);
    case NearestRounding::kRoundPreferFloor:
      return std::ceil(c - 0.5);
    case NearestRounding::kRoundPreferCeil:
      return std::floor(c + 0.5);
  }
  return c;
}

/// Keys, "Cubic convolution interpolation for digital image processing" (1981), eq. 5 with its free parameter
/// a: the kernel at distance d >= 0.
double cubic_kernel(double d, double a) {
  if (d <= 1) return ((a + 2) * d - (a + 3)) * d * d + 1;
  if (d < 2) return ((a * d - 5 * a) * d + 8 * a) * d - 4 * a;
  return 0;
}

/// The sum over the taps of f(weight) · f(x), and of f(residual).
template <typename F>
void resample(const ResizeOp& op, std::span<const Tensor> inputs, Tensor& output, F f) {
  const Nchw in = nchw(inputs[0].shape());
  const Nchw out = nchw(output.shape());
  const ResizeAxis rows = op.axis(0, in.h);
  const ResizeAxis columns = op.axis(1, in.w);
  const auto taps = static_cast<std::size_t>(rows.taps);
  const double* x = f64(inputs[0]);
  const double* residual = op.fusion().residual ? f64(inputs[1]) : nullptr;
  double* y = f64(output);
  for_ranges(in.n * in.c * out.h, 4, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t line = begin; line < end; ++line) {
      const double* plane = x + line / out.h * in.plane();
      const std::size_t i = static_cast<std::size_t>(line % out.h);
      for (std::size_t j = 0; j < static_cast<std::size_t>(out.w); ++j) {
        double sum = 0;
        for (std::size_t u = i * taps; u < (i + 1) * taps; ++u)
          for (std::size_t v = j * taps; v < (j + 1) * taps; ++v)
            sum +=
                f(rows.weight[u]) * f(columns.weight[v]) * f(plane[rows.index[u] * in.w + columns.index[v]]);
        const std::int64_t at = line * out.w + static_cast<std::int64_t>(j);
        y[at] = residual != nullptr ? sum + f(residual[at]) : sum;
      }
    }
  });
}

}  // namespace

ResizeAxis ResizeOp::axis(int axis, std::int64_t extent) const {
  const auto a = static_cast<std::size_t>(axis);
  const std::int64_t size = params_.size[a];
  const double input = static_cast<double>(extent);
  const double output = params_.scale ? input * (*params_.scale)[a] : static_cast<double>(size);
  ResizeAxis result{params_.mode == ResizeMode::kNearest  ? 1
                    : params_.mode == ResizeMode::kLinear ? 2
                                                          : 4,
                    {},
                    {}};
  const auto put = [&](double index, double weight) {
    result.index.push_back(static_cast<std::int64_t>(std::clamp(index, 0.0, input - 1)));
    result.weight.push_back(weight);
  };
  for (std::int64_t i = 0; i < size; ++i) {
    const double c = coordinate(params_.coordinates, static_cast<double>(i), input, output, size);
    const double base = std::floor(c);
    const double t = c - base;
    switch (params_.mode) {
      case ResizeMode::kNearest:
        put(round_nearest(params_.nearest, c), 1);
        break;
      case ResizeMode::kLinear:
        put(base, 1 - t);
        put(base + 1, t);
        break;
      case ResizeMode::kCubic:
        for (int k = -1; k <= 2; ++k) put(base + k, cubic_kernel(std::fabs(t - k), params_.cubic_a));
        break;
    }
  }
  return result;
}

std::string ResizeOp::attributes() const {
  constexpr std::array<std::string_view, 3> kModes = {"nearest", "linear", "cubic"};
  constexpr std::array<std::string_view, 4> kCoordinates = {"half_pixel", "pytorch_half_pixel",
                                                            "align_corners", "asymmetric"};
  std::string text = std::string(kModes[static_cast<std::size_t>(params_.mode)]) + " " +
                     std::string(kCoordinates[static_cast<std::size_t>(params_.coordinates)]) + " to " +
                     std::to_string(params_.size[0]) + "x" + std::to_string(params_.size[1]);
  if (params_.mode == ResizeMode::kCubic) text += " a " + number_text(params_.cubic_a);
  if (fusion_.residual) text += ", residual";
  return text;
}

Shape ResizeOp::infer(std::span<const Shape> inputs) const {
  const std::size_t count = fusion_.residual ? 2 : 1;
  require_input_count("resize", inputs, count, count);
  const Nchw in = nchw(inputs[0]);
  for (const std::int64_t size : params_.size)
    require(size >= 1 && size <= std::int64_t{1} << 31,
            "cannot resize to " + std::to_string(params_.size[0]) + "x" + std::to_string(params_.size[1]));
  if (params_.scale)
    for (const double s : *params_.scale)
      require(std::isfinite(s) && s > 0, "the scale " + number_text(s) + " is not positive");
  require(std::isfinite(params_.cubic_a), "the cubic parameter is not finite");
  const Shape output{in.n, in.c, params_.size[0], params_.size[1]};
  if (fusion_.residual) require_shape("residual", inputs[1], output);
  return output;
}

void ResizeOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  resample(*this, inputs, output, [](double v) { return v; });
}

/// The same sum over magnitudes.
void ResizeOp::error_scale(std::span<const Tensor> inputs, const Tensor& /*output*/, Tensor& scale) const {
  resample(*this, inputs, scale, [](double v) { return std::fabs(v); });
}

double ResizeOp::error_share(std::size_t /*index*/, std::span<const Shape> inputs) const {
  return 1.0 / static_cast<double>(inputs.size());
}

Value resize(Value x, const ResizeParams& params) {
  return x.graph().add(std::make_shared<ResizeOp>(params), {x});
}

Value resize_bilinear(Value x, std::int64_t height, std::int64_t width, bool align_corners) {
  ResizeParams params;
  params.mode = ResizeMode::kLinear;
  params.coordinates = align_corners ? ResizeCoordinates::kAlignCorners : ResizeCoordinates::kHalfPixel;
  params.size = {height, width};
  return resize(x, params);
}

Value resize_bicubic(Value x, std::int64_t height, std::int64_t width) {
  ResizeParams params;
  params.mode = ResizeMode::kCubic;
  params.coordinates = ResizeCoordinates::kHalfPixel;
  params.size = {height, width};
  return resize(x, params);
}

Value upsample_bilinear(Value x) {
  const Nchw in = nchw(x.shape());
  return resize_bilinear(x, 2 * in.h, 2 * in.w, false);
}

Value upsample_nearest(Value x, std::int64_t factor) {
  const Nchw in = nchw(x.shape());
  require_at_least("upsampling factor", factor, 1);
  require(factor <= std::int64_t{1} << 16,
          "the upsampling factor " + std::to_string(factor) + " is too large");
  ResizeParams params;
  params.mode = ResizeMode::kNearest;
  params.coordinates = ResizeCoordinates::kAsymmetric;
  params.nearest = NearestRounding::kFloor;
  params.size = {in.h * factor, in.w * factor};
  return resize(x, params);
}

}  // namespace slide::ops
