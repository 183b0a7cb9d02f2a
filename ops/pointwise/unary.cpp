#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "ops/common/elements.h"
#include "ops/pointwise/pointwise.h"
#include "ops/pointwise/unary_op.h"

namespace slide::ops {

double UnaryOp::evaluate(double x) const {
  switch (kind_) {
    case UnaryKind::kRelu:
      return x < 0 ? 0 : x;
    case UnaryKind::kRelu6:
      return x < 0 ? 0 : x > 6 ? 6 : x;
    case UnaryKind::kLeakyRelu:
      return x < 0 ? a_ * x : x;
    case UnaryKind::kElu:
      return x < 0 ? a_ * std::expm1(x) : x;
    case UnaryKind::kSigmoid:
      return x < 0 ? std::exp(x) / (1 + std::exp(x)) : 1 / (1 + std::exp(-x));
    case UnaryKind::kTanh:
      return std::tanh(x);
    case UnaryKind::kExp:
      return std::exp(x);
    case UnaryKind::kSqrt:
      return std::sqrt(x);
    case UnaryKind::kAbs:
      return std::fabs(x);
    case UnaryKind::kClip:
      return x < a_ ? a_ : x > b_ ? b_ : x;
    case UnaryKind::kAffine:
      return a_ * x + b_;
    case UnaryKind::kGreater:
      return x > a_ ? 1 : 0;
    case UnaryKind::kSilu:
      return x < -800 ? -0.0 : x / (1 + std::exp(-x));  // the limit, which -infinity has, too
    case UnaryKind::kGelu:
      return x < -40 ? -0.0 : 0.5 * x * std::erfc(-x * std::numbers::sqrt2 / 2);
  }
  return std::nan("");
}

std::string_view UnaryOp::type() const {
  constexpr std::array<std::string_view, 14> kNames = {"relu",   "relu6",   "leaky_relu", "elu", "sigmoid",
                                                       "tanh",   "exp",     "sqrt",       "abs", "clip",
                                                       "affine", "greater", "silu",       "gelu"};
  return kNames[static_cast<std::size_t>(kind_)];
}

std::string UnaryOp::attributes() const {
  switch (kind_) {
    case UnaryKind::kLeakyRelu:
      return "slope " + number_text(a_);
    case UnaryKind::kElu:
      return "alpha " + number_text(a_);
    case UnaryKind::kClip:
      return number_text(a_) + " to " + number_text(b_);
    case UnaryKind::kAffine:
      return "scale " + number_text(a_) + " shift " + number_text(b_);
    case UnaryKind::kGreater:
      return "than " + number_text(a_);
    default:
      return "";
  }
}

Shape UnaryOp::infer(std::span<const Shape> inputs) const {
  require_input_count(type(), inputs, 1, 1);
  if (kind_ == UnaryKind::kClip)
    require(a_ <= b_, "clip from " + number_text(a_) + " to " + number_text(b_) + " is no interval");
  else if (kind_ == UnaryKind::kGreater)
    require(!std::isnan(a_), "greater was given NaN as its threshold");
  else
    require(std::fabs(a_) <= std::numeric_limits<float>::max() &&
                std::fabs(b_) <= std::numeric_limits<float>::max(),
            std::string(type()) + " was given an attribute beyond the range of float32: " + attributes());
  return inputs[0];
}

void UnaryOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const double* x = f64(inputs[0]);
  double* y = f64(output);
  for_ranges(output.count(), kElementGrain, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end; ++i) y[i] = evaluate(x[i]);
  });
}

/// The sum of affine can cancel, so its error is relative to its two terms; everything else to the result.
void UnaryOp::error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const {
  if (kind_ != UnaryKind::kAffine) return Op::error_scale(inputs, output, scale);
  const double* x = f64(inputs[0]);
  double* s = f64(scale);
  for (std::int64_t i = 0; i < output.count(); ++i) s[i] = std::fabs(a_ * x[i]) + std::fabs(b_);
}

namespace {

Value unary(Value x, UnaryKind kind, double a = 0, double b = 0) {
  return x.graph().add(std::make_shared<UnaryOp>(kind, a, b), {x});
}

}  // namespace

Value relu(Value x) { return unary(x, UnaryKind::kRelu); }
Value relu6(Value x) { return unary(x, UnaryKind::kRelu6); }
Value leaky_relu(Value x, double slope) { return unary(x, UnaryKind::kLeakyRelu, slope); }
Value elu(Value x, double alpha) { return unary(x, UnaryKind::kElu, alpha); }
Value sigmoid(Value x) { return unary(x, UnaryKind::kSigmoid); }
Value tanh(Value x) { return unary(x, UnaryKind::kTanh); }
Value exp(Value x) { return unary(x, UnaryKind::kExp); }
Value sqrt(Value x) { return unary(x, UnaryKind::kSqrt); }
Value abs(Value x) { return unary(x, UnaryKind::kAbs); }
Value clip(Value x, double low, double high) { return unary(x, UnaryKind::kClip, low, high); }
Value affine(Value x, double scale, double shift) { return unary(x, UnaryKind::kAffine, scale, shift); }
Value greater(Value x, double threshold) { return unary(x, UnaryKind::kGreater, threshold); }
Value silu(Value x) { return unary(x, UnaryKind::kSilu); }
Value gelu(Value x) { return unary(x, UnaryKind::kGelu); }

}  // namespace slide::ops
