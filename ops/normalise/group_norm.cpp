#include <cmath>

#include "ops/common/elements.h"
#include "ops/normalise/moments.h"
#include "ops/normalise/normalise.h"
#include "ops/normalise/normalise_ops.h"
#include "ops/pointwise/unary_row.h"

namespace slide::ops {
namespace {

/// Calls f(element, channel, moments of its group) for every element.
template <typename F>
void for_groups(const Tensor& input, std::int64_t groups, F f) {
  const Nchw in = nchw(input.shape());
  const double* x = f64(input);
  const std::int64_t channels = in.c / groups;
  const std::int64_t count = channels * in.plane();
  for_ranges(in.n * groups, 1, [&](std::int64_t group, std::int64_t) {
    const Moments m = moments(x + group * count, count);
    for (std::int64_t i = 0; i < count; ++i)
      f(group * count + i, group % groups * channels + i / in.plane(), m);
  });
}

}  // namespace

std::string GroupNormOp::attributes() const {
  std::string text = std::to_string(groups_) + " groups eps " + number_text(eps_);
  if (fusion_.residual) text += ", residual";
  if (fusion_.activation) text += ", " + std::string(fusion_.activation->type());
  return text;
}

Shape GroupNormOp::infer(std::span<const Shape> inputs) const {
  const std::size_t count = fusion_.residual ? 4 : 3;
  require_input_count("group_norm", inputs, count, count);
  const Nchw in = nchw(inputs[0]);
  require_at_least("number of groups", groups_, 1);
  require(in.c % groups_ == 0, std::to_string(in.c) + " channels of " + inputs[0].text() +
                                   " do not divide into " + std::to_string(groups_) + " groups");
  require(std::isfinite(eps_) && eps_ >= 0, "eps is " + number_text(eps_));
  require_shape("weight", inputs[1], {in.c});
  require_shape("bias", inputs[2], {in.c});
  if (fusion_.residual) require_shape("residual", inputs[3], inputs[0]);
  return inputs[0];
}

void GroupNormOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const double* x = f64(inputs[0]);
  const double* weight = f64(inputs[1]);
  const double* bias = f64(inputs[2]);
  double* y = f64(output);
  for_groups(inputs[0], groups_, [&](std::int64_t i, std::int64_t c, Moments m) {
    y[i] = m.centred(x[i]) / std::sqrt(m.variance + eps_) * weight[c] + bias[c];
    if (fusion_.residual) y[i] += f64(inputs[3])[i];
    if (fusion_.activation) y[i] = fusion_.activation->evaluate(y[i]);
  });
}

/// |weight| · |x - mean| / sqrt(var + eps) + |bias|, as for batch norm, and what the statistics add; plus
/// |residual|. An activation of slope at most L makes of it L·s + |y|.
void GroupNormOp::error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const {
  const double* x = f64(inputs[0]);
  const double* weight = f64(inputs[1]);
  const double* bias = f64(inputs[2]);
  double* s = f64(scale);
  const std::int64_t count = inputs[0].count() / inputs[0].shape()[0] / groups_;
  const double slope = fusion_.activation ? activation_slope(*fusion_.activation).value_or(1.0) : 1;
  for_groups(inputs[0], groups_, [&](std::int64_t i, std::int64_t c, Moments m) {
    const double inverse = 1 / std::sqrt(m.variance + eps_);
    const double size = std::fabs(m.centred(x[i])) * inverse + statistics_scale(m, inverse, count);
    s[i] = size * std::fabs(weight[c]) + std::fabs(bias[c]);
    if (fusion_.residual) s[i] += std::fabs(f64(inputs[3])[i]);
    if (fusion_.activation) s[i] = slope * s[i] + std::fabs(f64(output)[i]);
  });
}

std::string WeightStandardiseOp::attributes() const { return "eps " + number_text(eps_); }

Shape WeightStandardiseOp::infer(std::span<const Shape> inputs) const {
  require_input_count("weight_standardise", inputs, 1, 1);
  static_cast<void>(nchw(inputs[0]));
  require(std::isfinite(eps_) && eps_ >= 0, "eps is " + number_text(eps_));
  return inputs[0];
}

void WeightStandardiseOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const std::int64_t filters = output.shape()[0];
  const std::int64_t count = output.count() / filters;
  const double* w = f64(inputs[0]);
  double* y = f64(output);
  for_ranges(filters, 1, [&](std::int64_t filter, std::int64_t) {
    const Moments m = moments(w + filter * count, count);
    for (std::int64_t i = filter * count; i < (filter + 1) * count; ++i)
      y[i] = m.centred(w[i]) / std::sqrt(m.variance + eps_);
  });
}

/// |w - mean| / sqrt(var + eps), and what the statistics add.
void WeightStandardiseOp::error_scale(std::span<const Tensor> inputs, const Tensor& output,
                                      Tensor& scale) const {
  const std::int64_t filters = output.shape()[0];
  const std::int64_t count = output.count() / filters;
  const double* w = f64(inputs[0]);
  double* s = f64(scale);
  for (std::int64_t filter = 0; filter < filters; ++filter) {
    const Moments m = moments(w + filter * count, count);
    const double inverse = 1 / std::sqrt(m.variance + eps_);
    for (std::int64_t i = filter * count; i < (filter + 1) * count; ++i)
      s[i] = std::fabs(m.centred(w[i])) * inverse + statistics_scale(m, inverse, count);
  }
}

Value group_norm(Value x, std::int64_t groups, Value weight, Value bias, double eps) {
  return x.graph().add(std::make_shared<GroupNormOp>(groups, eps), {x, weight, bias});
}

Value weight_standardise(Value weight, double eps) {
  return weight.graph().add(std::make_shared<WeightStandardiseOp>(eps), {weight});
}

}  // namespace slide::ops
