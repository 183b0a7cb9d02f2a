#include <cmath>

#include "ops/common/elements.h"
#include "ops/normalise/normalise.h"
#include "ops/normalise/normalise_ops.h"

namespace slide::ops {
namespace {

/// Calls f(element, channel) for every element of N×C×....
template <typename F>
void for_channels(const Shape& shape, F f) {
  const AxisView view = axis_view(shape, 1);
  for_ranges(view.outer * view.axis, 1, [&](std::int64_t plane, std::int64_t) {
    for (std::int64_t i = 0; i < view.inner; ++i) f(plane * view.inner + i, plane % view.axis);
  });
}

}  // namespace

std::string BatchNormOp::attributes() const { return "eps " + number_text(eps_); }

Shape BatchNormOp::infer(std::span<const Shape> inputs) const {
  require_input_count("batch_norm", inputs, 5, 5);
  require(inputs[0].rank() >= 2,
          "batch_norm needs a tensor of rank 2 to 5 and was given " + inputs[0].text());
  require(std::isfinite(eps_) && eps_ >= 0, "eps is " + number_text(eps_));
  const Shape channels{inputs[0][1]};
  require_shape("weight", inputs[1], channels);
  require_shape("bias", inputs[2], channels);
  require_shape("running mean", inputs[3], channels);
  require_shape("running variance", inputs[4], channels);
  return inputs[0];
}

void BatchNormOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const double* x = f64(inputs[0]);
  const double* weight = f64(inputs[1]);
  const double* bias = f64(inputs[2]);
  const double* mean = f64(inputs[3]);
  const double* var = f64(inputs[4]);
  double* y = f64(output);
  for_channels(output.shape(), [&](std::int64_t i, std::int64_t c) {
    y[i] = (x[i] - mean[c]) / std::sqrt(var[c] + eps_) * weight[c] + bias[c];
  });
}

/// |weight| / sqrt(var + eps) · (|x - mean| + 2^-22·|mean|) + |bias|: the mean is rounded to float32 for the
/// subtraction, and the rest of it goes into the shift.
void BatchNormOp::error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const {
  const double* x = f64(inputs[0]);
  const double* weight = f64(inputs[1]);
  const double* bias = f64(inputs[2]);
  const double* mean = f64(inputs[3]);
  const double* var = f64(inputs[4]);
  double* s = f64(scale);
  for_channels(output.shape(), [&](std::int64_t i, std::int64_t c) {
    const double apart = std::fabs(x[i] - mean[c]) + 0x1p-22 * std::fabs(mean[c]);
    s[i] = std::fabs(weight[c]) / std::sqrt(var[c] + eps_) * apart + std::fabs(bias[c]);
  });
}

Value batch_norm(Value x, Value weight, Value bias, Value running_mean, Value running_var, double eps) {
  return x.graph().add(std::make_shared<BatchNormOp>(eps), {x, weight, bias, running_mean, running_var});
}

}  // namespace slide::ops
