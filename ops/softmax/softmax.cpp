#include "ops/softmax/softmax.h"

#include <algorithm>
#include <cmath>

#include "ops/common/elements.h"
#include "ops/softmax/softmax_op.h"

namespace slide::ops {
namespace {

/// Calls f(first element, step, count) for every line along the axis.
template <typename F>
void for_lines(const Shape& shape, int axis, F f) {
  const AxisView view = axis_view(shape, require_axis("softmax", axis, shape));
  for_ranges(view.outer * view.inner, 64, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t line = begin; line < end; ++line)
      f(line / view.inner * view.axis * view.inner + line % view.inner, view.inner, view.axis);
  });
}

double largest_of_line(const double* x, std::int64_t step, std::int64_t count) {
  double largest = x[0];
  for (std::int64_t i = 1; i < count; ++i) largest = std::max(largest, x[i * step]);
  return largest;
}

}  // namespace

Shape SoftmaxOp::infer(std::span<const Shape> inputs) const {
  require_input_count("softmax", inputs, 1, 1);
  static_cast<void>(require_axis("softmax", axis_, inputs[0]));
  require(inputs[0].count() > 0, "softmax was given a tensor without elements, " + inputs[0].text());
  return inputs[0];
}

void SoftmaxOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const double* input = f64(inputs[0]);
  double* result = f64(output);
  for_lines(output.shape(), axis_, [&](std::int64_t first, std::int64_t step, std::int64_t count) {
    const double* x = input + first;
    double* y = result + first;
    const double largest = largest_of_line(x, step, count);
    double sum = 0;
    for (std::int64_t i = 0; i < count; ++i) sum += y[i * step] = std::exp(x[i * step] - largest);
    for (std::int64_t i = 0; i < count; ++i) y[i * step] /= sum;
  });
}

/// y_i · (1 + d_i + sum over j of y_j·d_j), d = max - x: rounding the difference by u·d changes its
/// exponential by the factor 1 + u·d, in the numerator and in every term of the sum.
void SoftmaxOp::error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const {
  const double* input = f64(inputs[0]);
  const double* result = f64(output);
  double* scales = f64(scale);
  for_lines(output.shape(), axis_, [&](std::int64_t first, std::int64_t step, std::int64_t count) {
    const double* x = input + first;
    const double* y = result + first;
    double* s = scales + first;
    const double largest = largest_of_line(x, step, count);
    // A term without weight adds nothing, even where its distance is infinite.
    const auto weighted = [&](std::int64_t i) {
      return y[i * step] > 0 ? y[i * step] * (largest - x[i * step]) : 0;
    };
    double mean = 0;
    for (std::int64_t i = 0; i < count; ++i) mean += weighted(i);
    for (std::int64_t i = 0; i < count; ++i) s[i * step] = y[i * step] * (1 + mean) + weighted(i);
  });
}

Value softmax(Value x, int axis) { return x.graph().add(std::make_shared<SoftmaxOp>(axis), {x}); }

}  // namespace slide::ops
