#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <span>

#include "ops/common/elements.h"
#include "ops/pointwise/binary_op.h"
#include "ops/pointwise/broadcast.h"
#include "ops/pointwise/pointwise.h"

namespace slide::ops {
namespace {

/// y = f(a, b) along a row in which a and b step by 0 or 1. Weights are folded by this: numbers that stay the
/// same are told to the compiler.
template <typename F>
void map_row(const double* a, std::int64_t a_step, const double* b, std::int64_t b_step, std::span<double> y,
             F f) {
  const std::size_t n = y.size();
  if (a_step != 0 && b_step != 0) {
    for (std::size_t i = 0; i < n; ++i) y[i] = f(a[i], b[i]);
  } else if (a_step != 0) {
    for (std::size_t i = 0; i < n; ++i) y[i] = f(a[i], *b);
  } else if (b_step != 0) {
    for (std::size_t i = 0; i < n; ++i) y[i] = f(*a, b[i]);
  } else {
    std::ranges::fill(y, f(*a, *b));
  }
}

/// y = f(a, b) for every element.
template <typename F>
void map(std::span<const Tensor> inputs, Tensor& output, F f) {
  const BroadcastRows rows(inputs[0].shape(), inputs[1].shape(), output.shape());
  const double* a = f64(inputs[0]);
  const double* b = f64(inputs[1]);
  double* y = f64(output);
  const std::int64_t length = rows.length();
  for_ranges(output.count(), kElementGrain, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end;) {
      const std::int64_t row = i / length;
      const std::int64_t stop = std::min(end, (row + 1) * length);
      const BroadcastRows::Start start = rows.start(row);
      const std::int64_t column = i - row * length;
      const double* left = a + start.a + column * rows.a_step();
      const double* right = b + start.b + column * rows.b_step();
      map_row(left, rows.a_step(), right, rows.b_step(), {y + i, static_cast<std::size_t>(stop - i)}, f);
      i = stop;
    }
  });
}

}  // namespace

double BinaryOp::evaluate(double a, double b) const {
  switch (kind_) {
    case BinaryKind::kAdd:
      return a + b;
    case BinaryKind::kSub:
      return a - b;
    case BinaryKind::kMul:
      return a * b;
    case BinaryKind::kDiv:
      return a / b;
    case BinaryKind::kMinimum:
      return std::isnan(a) || a < b ? a : b;
    case BinaryKind::kMaximum:
      return std::isnan(a) || a > b ? a : b;
  }
  return std::nan("");
}

std::string_view BinaryOp::type() const {
  constexpr std::array<std::string_view, 6> kNames = {"add", "sub", "mul", "div", "minimum", "maximum"};
  return kNames[static_cast<std::size_t>(kind_)];
}

Shape BinaryOp::infer(std::span<const Shape> inputs) const {
  require_input_count(type(), inputs, 2, 2);
  return broadcast_shape(inputs[0], inputs[1]);
}

void BinaryOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  if (kind_ == BinaryKind::kMul) return map(inputs, output, std::multiplies<>());
  map(inputs, output, [this](double a, double b) { return evaluate(a, b); });
}

/// A sum or difference is measured against its two terms, so that cancellation in the inputs of a larger
/// computation is not held against it; everything else against the result.
double BinaryOp::error_share(std::size_t index, std::span<const Shape> inputs) const {
  if (kind_ == BinaryKind::kMul || kind_ == BinaryKind::kDiv) return 1;
  return Op::error_share(index, inputs);
}

void BinaryOp::error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const {
  if (kind_ != BinaryKind::kAdd && kind_ != BinaryKind::kSub) return Op::error_scale(inputs, output, scale);
  map(inputs, scale, [](double a, double b) { return std::fabs(a) + std::fabs(b); });
}

namespace {

Value binary(Value a, Value b, BinaryKind kind) {
  return a.graph().add(std::make_shared<BinaryOp>(kind), {a, b});
}

}  // namespace

Value add(Value x, Value other) { return binary(x, other, BinaryKind::kAdd); }
Value sub(Value x, Value other) { return binary(x, other, BinaryKind::kSub); }
Value mul(Value x, Value other) { return binary(x, other, BinaryKind::kMul); }
Value div(Value x, Value other) { return binary(x, other, BinaryKind::kDiv); }
Value minimum(Value x, Value other) { return binary(x, other, BinaryKind::kMinimum); }
Value maximum(Value x, Value other) { return binary(x, other, BinaryKind::kMaximum); }

}  // namespace slide::ops
