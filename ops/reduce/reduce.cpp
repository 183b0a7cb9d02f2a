#include "ops/reduce/reduce.h"

#include <cmath>

#include "ops/common/elements.h"
#include "ops/reduce/reduce_op.h"

namespace slide::ops {
namespace {

/// For every input element, the output element it goes into.
template <typename F>
void for_elements(const Shape& input, const Shape& output, F f) {
  std::array<std::int64_t, Shape::kMaxRank> stride{};  // of the output along the input's axes, 0 if reduced
  std::int64_t size = 1;
  for (int axis = input.rank() - 1; axis >= 0; --axis) {
    stride[static_cast<std::size_t>(axis)] = output[axis] == 1 ? 0 : size;
    size *= output[axis];
  }
  for (std::int64_t i = 0; i < input.count(); ++i) {
    std::int64_t rest = i;
    std::int64_t to = 0;
    for (int axis = input.rank() - 1; axis >= 0; --axis) {
      to += rest % input[axis] * stride[static_cast<std::size_t>(axis)];
      rest /= input[axis];
    }
    f(i, to);
  }
}

/// Mean of f(x).
template <typename F>
void mean(const Tensor& input, Tensor& output, F f) {
  const double* x = f64(input);
  double* y = f64(output);
  for (double& v : output.mutable_data<double>()) v = 0;
  for_elements(input.shape(), output.shape(), [&](std::int64_t i, std::int64_t to) { y[to] += f(x[i]); });
  const double count = static_cast<double>(input.count()) / static_cast<double>(output.count());
  for (double& v : output.mutable_data<double>()) v /= count;
}

}  // namespace

std::array<bool, Shape::kMaxRank> ReduceOp::reduced(const Shape& shape) const {
  require(!axes_.empty(), std::string(type()) + " was given no axis");
  std::array<bool, Shape::kMaxRank> result{};
  for (const int axis : axes_) {
    bool& flag = result[static_cast<std::size_t>(require_axis(type(), axis, shape))];
    require(!flag, std::string(type()) + " was given axis " + std::to_string(axis) + " twice");
    flag = true;
  }
  return result;
}

std::string_view ReduceOp::type() const {
  constexpr std::array<std::string_view, 3> kNames = {"reduce_min", "reduce_max", "reduce_mean"};
  return kNames[static_cast<std::size_t>(kind_)];
}

std::string ReduceOp::attributes() const {
  std::string text = "axes";
  for (const int axis : axes_) text += " " + std::to_string(axis);
  return text;
}

Shape ReduceOp::infer(std::span<const Shape> inputs) const {
  require_input_count(type(), inputs, 1, 1);
  require(inputs[0].count() > 0,
          std::string(type()) + " was given a tensor without elements, " + inputs[0].text());
  const std::array<bool, Shape::kMaxRank> flags = reduced(inputs[0]);
  Shape output = inputs[0];
  for (int axis = 0; axis < output.rank(); ++axis)
    if (flags[static_cast<std::size_t>(axis)]) output = output.with(axis, 1);
  return output;
}

void ReduceOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  if (kind_ == ReduceKind::kMean) return mean(inputs[0], output, [](double v) { return v; });
  const double sign = kind_ == ReduceKind::kMax ? 1 : -1;
  const double* x = f64(inputs[0]);
  double* y = f64(output);
  for (double& v : output.mutable_data<double>()) v = -sign * INFINITY;
  for_elements(inputs[0].shape(), output.shape(), [&](std::int64_t i, std::int64_t to) {
    if (std::isnan(x[i]) || sign * x[i] > sign * y[to]) y[to] = x[i];
  });
}

/// The mean of magnitudes for means, |y| for the others.
void ReduceOp::error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const {
  if (kind_ != ReduceKind::kMean) return Op::error_scale(inputs, output, scale);
  mean(inputs[0], scale, [](double v) { return std::fabs(v); });
}

namespace {

Value reduce(Value x, ReduceKind kind, const std::vector<int>& axes) {
  return x.graph().add(std::make_shared<ReduceOp>(kind, axes), {x});
}

}  // namespace

Value reduce_min(Value x, const std::vector<int>& axes) { return reduce(x, ReduceKind::kMin, axes); }
Value reduce_max(Value x, const std::vector<int>& axes) { return reduce(x, ReduceKind::kMax, axes); }
Value reduce_mean(Value x, const std::vector<int>& axes) { return reduce(x, ReduceKind::kMean, axes); }

}  // namespace slide::ops
