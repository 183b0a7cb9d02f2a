// What functions of one and two values do to means and variances (runtime/sensitivity.h).

#include <algorithm>
#include <array>
#include <cmath>

#include "ops/pointwise/binary_op.h"
#include "ops/pointwise/unary_op.h"

namespace slide::ops {
namespace {

/// The middles of sixteen parts of a normal distribution, equally probable each, those above zero; scaled to
/// variance 1.
constexpr std::array<double, 8> kNormal = {0.0816, 0.2468, 0.4186, 0.6025, 0.8078, 1.0509, 1.3714, 1.9382};

}  // namespace

FunctionStatistics UnaryOp::statistics_at(double mean, double variance) const {
  const double deviation = std::sqrt(variance);
  double sum = 0;
  double square = 0;
  double slopes = 0;
  constexpr double kCount = 2.0 * std::size(kNormal);
  for (const double z : kNormal)
    for (const double sign : {-1.0, 1.0}) {
      const double x = mean + sign * z * deviation;
      const double step = 1e-4 * std::max(1.0, std::fabs(x));
      const double y = evaluate(x);
      const double slope =
          kind_ == UnaryKind::kGreater ? 0 : (evaluate(x + step) - evaluate(x - step)) / (2 * step);
      sum += y / kCount;
      square += y * y / kCount;
      slopes += slope * slope / kCount;
    }
  return {sum, std::max(0.0, square - sum * sum), slopes};
}

NodeStatistics UnaryOp::statistics(const StatisticsCall& call) const {
  const ValueStatistics& x = call.inputs[0];
  NodeStatistics result;
  for (std::size_t c = 0; c < x.channels(); ++c) {
    const FunctionStatistics y = statistics_at(x.mean[c], x.variance[c]);
    result.output.mean.push_back(y.mean);
    result.output.variance.push_back(y.variance);
  }
  return result;
}

NodeStatistics BinaryOp::statistics(const StatisticsCall& call) const {
  std::array<ValueStatistics, 2> inputs;
  std::size_t channels = 1;
  for (std::size_t k = 0; k < 2; ++k) {
    inputs[k] = call.constants[k].empty() ? call.inputs[k] : statistics_of(call.constants[k]);
    channels = std::max(channels, inputs[k].channels());
  }
  const bool sum = kind_ == BinaryKind::kAdd || kind_ == BinaryKind::kSub;
  for (const ValueStatistics& s : inputs)
    if ((!sum && kind_ != BinaryKind::kMul) || (s.channels() != channels && s.channels() != 1))
      return handed_on(*this, call);
  NodeStatistics result;
  for (std::size_t c = 0; c < channels; ++c) {
    const auto mean = [&](std::size_t k) { return inputs[k].mean[inputs[k].channels() == 1 ? 0 : c]; };
    const std::array square = {inputs[0].square(c), inputs[1].square(c)};
    const double m = sum ? mean(0) + (kind_ == BinaryKind::kSub ? -1 : 1) * mean(1) : mean(0) * mean(1);
    const double all =
        sum ? m * m + square[0] - mean(0) * mean(0) + square[1] - mean(1) * mean(1) : square[0] * square[1];
    result.output.mean.push_back(m);
    result.output.variance.push_back(std::max(0.0, all - m * m));
  }
  return result;
}

}  // namespace slide::ops
