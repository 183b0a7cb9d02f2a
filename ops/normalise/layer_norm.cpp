#include <cmath>

#include "ops/common/elements.h"
#include "ops/normalise/moments.h"
#include "ops/normalise/normalise.h"
#include "ops/normalise/normalise_ops.h"

namespace slide::ops {
namespace {

/// Calls f(element, index along the axis, moments of its line) for every element.
template <typename F>
void for_lines(const Tensor& input, int axis, F f) {
  const AxisView view = axis_view(input.shape(), require_axis("layer_norm", axis, input.shape()));
  const double* x = f64(input);
  for_ranges(view.outer * view.inner, 64, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t line = begin; line < end; ++line) {
      const std::int64_t first = line / view.inner * view.axis * view.inner + line % view.inner;
      const Moments m = moments(x + first, view.axis, view.inner);
      for (std::int64_t i = 0; i < view.axis; ++i) f(first + i * view.inner, i, m);
    }
  });
}

}  // namespace

std::string LayerNormOp::attributes() const {
  return "axis " + std::to_string(axis_) + " eps " + number_text(eps_);
}

Shape LayerNormOp::infer(std::span<const Shape> inputs) const {
  require_input_count("layer_norm", inputs, 3, 3);
  const Shape extent{inputs[0][require_axis("layer_norm", axis_, inputs[0])]};
  require(inputs[0].count() > 0, "layer_norm was given a tensor without elements, " + inputs[0].text());
  require(std::isfinite(eps_) && eps_ >= 0, "eps is " + number_text(eps_));
  require_shape("weight", inputs[1], extent);
  require_shape("bias", inputs[2], extent);
  return inputs[0];
}

void LayerNormOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const double* x = f64(inputs[0]);
  const double* weight = f64(inputs[1]);
  const double* bias = f64(inputs[2]);
  double* y = f64(output);
  for_lines(inputs[0], axis_, [&](std::int64_t at, std::int64_t i, Moments m) {
    y[at] = m.centred(x[at]) / std::sqrt(m.variance + eps_) * weight[i] + bias[i];
  });
}

/// |weight| · |x - mean| / sqrt(var + eps) + |bias|, and what the statistics add.
void LayerNormOp::error_scale(std::span<const Tensor> inputs, const Tensor& /*output*/, Tensor& scale) const {
  const double* x = f64(inputs[0]);
  const double* weight = f64(inputs[1]);
  const double* bias = f64(inputs[2]);
  double* s = f64(scale);
  const std::int64_t count = inputs[1].count();
  for_lines(inputs[0], axis_, [&](std::int64_t at, std::int64_t i, Moments m) {
    const double inverse = 1 / std::sqrt(m.variance + eps_);
    const double size = std::fabs(m.centred(x[at])) * inverse + statistics_scale(m, inverse, count);
    s[at] = size * std::fabs(weight[i]) + std::fabs(bias[i]);
  });
}

Value layer_norm(Value x, int axis, Value weight, Value bias, double eps) {
  return x.graph().add(std::make_shared<LayerNormOp>(axis, eps), {x, weight, bias});
}

}  // namespace slide::ops
