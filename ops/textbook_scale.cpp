#include "ops/textbook_scale.h"

#include <algorithm>
#include <cmath>

#include "ops/common/elements.h"
#include "ops/normalise/moments.h"
#include "ops/normalise/normalise_ops.h"
#include "ops/pointwise/unary_op.h"
#include "ops/resize/resize_op.h"

namespace slide::ops {
namespace {

void add_unary(const UnaryOp& op, std::span<const double> x, std::span<double> scale) {
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (op.kind() == UnaryKind::kElu && x[i] < 0) scale[i] += std::fabs(op.a()) * (std::exp(x[i]) + 1);
    if (op.kind() == UnaryKind::kGelu) scale[i] += std::fabs(x[i]);
  }
}

/// For `lines` groups of `count` numbers that are `step` apart: 2 |mean| / σ, times the weight of each.
template <typename First, typename Weight>
void add_means(const Tensor& x, std::int64_t lines, std::int64_t count, std::int64_t step, double eps,
               std::span<double> scale, First first, Weight weight) {
  for (std::int64_t line = 0; line < lines; ++line) {
    const std::int64_t begin = first(line);
    const Moments m = moments(f64(x) + begin, count, step);
    const double size = 2 * std::fabs(m.mean()) / std::sqrt(m.variance + eps);
    for (std::int64_t i = 0; i < count; ++i) {
      const std::int64_t at = begin + i * step;
      scale[static_cast<std::size_t>(at)] += size * std::fabs(weight(at, i));
    }
  }
}

void add_group_norm(const GroupNormOp& op, std::span<const Tensor> inputs, std::span<double> scale) {
  const Nchw s = nchw(inputs[0].shape());
  const std::int64_t count = s.c * s.plane() / op.groups();
  add_means(
      inputs[0], s.n * op.groups(), count, 1, op.eps(), scale,
      [&](std::int64_t line) { return line * count; },
      [&](std::int64_t at, std::int64_t) { return f64(inputs[1])[at / s.plane() % s.c]; });
}

void add_layer_norm(const LayerNormOp& op, std::span<const Tensor> inputs, std::span<double> scale) {
  const AxisView view =
      axis_view(inputs[0].shape(), require_axis("layer_norm", op.axis(), inputs[0].shape()));
  add_means(
      inputs[0], view.outer * view.inner, view.axis, view.inner, op.eps(), scale,
      [&](std::int64_t line) { return line / view.inner * view.axis * view.inner + line % view.inner; },
      [&](std::int64_t, std::int64_t i) { return f64(inputs[1])[i]; });
}

void add_batch_norm(const BatchNormOp& op, std::span<const Tensor> inputs, std::span<double> scale) {
  const Nchw s = nchw(inputs[0].shape());
  for (std::int64_t i = 0; i < inputs[0].count(); ++i) {
    const std::int64_t c = i / s.plane() % s.c;
    scale[static_cast<std::size_t>(i)] +=
        2 * std::fabs(f64(inputs[1])[c] * f64(inputs[3])[c]) / std::sqrt(f64(inputs[4])[c] + op.eps());
  }
}

/// The largest magnitudes of 5x5 pixels, resampled.
void add_resize(const ResizeOp& op, const Tensor& x, std::span<double> scale) {
  const Nchw s = nchw(x.shape());
  Tensor largest = Tensor::zeros(DType::kF64, x.shape());
  for (std::int64_t row = 0; row < s.n * s.c * s.h; ++row)
    for (std::int64_t j = 0; j < s.w; ++j) {
      double& most = f64(largest)[row * s.w + j];
      const std::int64_t plane = row / s.h * s.h;
      for (std::int64_t u = std::max(plane, row - 2); u <= std::min(plane + s.h - 1, row + 2); ++u)
        for (std::int64_t v = std::max<std::int64_t>(0, j - 2); v <= std::min(s.w - 1, j + 2); ++v)
          most = std::max(most, std::fabs(f64(x)[u * s.w + v]));
    }
  const Shape output{s.n, s.c, op.params().size[0], op.params().size[1]};
  Tensor around(DType::kF64, output);
  ResizeOp(op.params()).error_scale(std::span(&largest, 1), around, around);
  for (std::size_t i = 0; i < scale.size(); ++i) scale[i] += std::as_const(around).data<double>()[i];
}

}  // namespace

void add_textbook_scale(const Op& op, std::span<const Tensor> inputs, std::span<double> scale) {
  if (const auto* unary = dynamic_cast<const UnaryOp*>(&op))
    add_unary(*unary, inputs[0].data<double>(), scale);
  if (const auto* norm = dynamic_cast<const BatchNormOp*>(&op)) add_batch_norm(*norm, inputs, scale);
  if (const auto* norm = dynamic_cast<const GroupNormOp*>(&op)) add_group_norm(*norm, inputs, scale);
  if (const auto* norm = dynamic_cast<const LayerNormOp*>(&op)) add_layer_norm(*norm, inputs, scale);
  if (const auto* norm = dynamic_cast<const WeightStandardiseOp*>(&op)) {
    const std::int64_t filters = inputs[0].shape()[0];
    const std::int64_t count = inputs[0].count() / filters;
    add_means(
        inputs[0], filters, count, 1, norm->eps(), scale, [&](std::int64_t line) { return line * count; },
        [](std::int64_t, std::int64_t) { return 1.0; });
  }
  if (const auto* resize = dynamic_cast<const ResizeOp*>(&op)) add_resize(*resize, inputs[0], scale);
}

}  // namespace slide::ops
