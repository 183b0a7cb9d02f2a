// What normalisations do to means and variances (runtime/sensitivity.h).

#include <algorithm>
#include <cmath>

#include "ops/normalise/normalise_ops.h"

namespace slide::ops {
namespace {

/// y = (x - mean) · weight / deviation + bias, of one channel.
void add_channel(const ValueStatistics& x, std::size_t c, double mean, double deviation, double weight,
                 double bias, ValueStatistics& y) {
  const double factor = weight / deviation;
  y.mean.push_back((x.mean[c] - mean) * factor + bias);
  y.variance.push_back(x.variance[c] * factor * factor);
}

bool constant(std::span<const Tensor> inputs) {
  for (const Tensor& t : inputs)
    if (t.empty()) return false;
  return true;
}

}  // namespace

NodeStatistics BatchNormOp::statistics(const StatisticsCall& call) const {
  const ValueStatistics& x = call.inputs[0];
  if (!constant(call.constants.subspan(1))) return handed_on(*this, call);
  const auto value = [&](std::size_t k, std::size_t c) { return call.constants[k].data<double>()[c]; };
  NodeStatistics y;
  for (std::size_t c = 0; c < x.channels(); ++c)
    add_channel(x, c, value(3, c), std::sqrt(value(4, c) + eps_), value(1, c), value(2, c), y.output);
  return y;
}

NodeStatistics GroupNormOp::statistics(const StatisticsCall& call) const {
  const ValueStatistics& x = call.inputs[0];
  if (!constant(call.constants.subspan(1, 2)) || fusion_.residual || fusion_.activation)
    return handed_on(*this, call);
  const std::size_t size = x.channels() / static_cast<std::size_t>(groups_);
  NodeStatistics y;
  for (std::size_t first = 0; first < x.channels(); first += size) {
    double mean = 0;
    double square = 0;
    for (std::size_t c = first; c < first + size; ++c) {
      mean += x.mean[c] / static_cast<double>(size);
      square += x.square(c) / static_cast<double>(size);
    }
    const double deviation = std::sqrt(std::max(0.0, square - mean * mean) + eps_);
    for (std::size_t c = first; c < first + size; ++c)
      add_channel(x, c, mean, deviation, call.constants[1].data<double>()[c],
                  call.constants[2].data<double>()[c], y.output);
  }
  return y;
}

}  // namespace slide::ops
