// What a fused convolution's weights say of its result and its errors (runtime/sensitivity.h).

#include <algorithm>
#include <cmath>
#include <vector>

#include "ops/conv2d/conv2d_op.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

/// One channel on its way from sums to result: moments, and the expected square of what roundings do, in units
/// of that of terms of the result's size.
struct Channel {
  double mean = 0, variance = 0, own = 0;
};

/// x as the convolution sees it: with the joined channels, below zero cut off.
ValueStatistics convolved(const Conv2dFusion& fusion, const StatisticsCall& call) {
  ValueStatistics x = call.inputs[0];
  if (fusion.joined > 0) {
    const ValueStatistics& joined = call.inputs.back();
    x.mean.insert(x.mean.end(), joined.mean.begin(), joined.mean.end());
    x.variance.insert(x.variance.end(), joined.variance.begin(), joined.variance.end());
  }
  if (fusion.relu_input)
    for (std::size_t c = 0; c < x.channels(); ++c) {
      const FunctionStatistics y = UnaryOp(UnaryKind::kRelu).statistics_at(x.mean[c], x.variance[c]);
      x.mean[c] = y.mean;
      x.variance[c] = y.variance;
    }
  return x;
}

/// The sums of one filter. With q the sum of a channel's squared weights and w that of the weights, what
/// differs from pixel to pixel adds up as q, what is the same at all taps (the mean, and the rounding of a flat
/// image's values) as w². Half of a term's rounding is the weight's, which differs at each tap.
Channel sums_of(const Conv2dGeometry& g, std::int64_t filter, const ValueStatistics& x, const double* weight,
                double bias) {
  Channel y;
  y.mean = bias;
  const std::int64_t taps = g.kheight * g.kwidth;
  const std::int64_t first = filter / g.group_oc * g.group_ic;
  for (std::int64_t c = 0; c < g.group_ic; ++c) {
    const double* at = weight + (filter * g.group_ic + c) * taps;
    double w = 0;
    double q = 0;
    for (std::int64_t t = 0; t < taps; ++t) {
      w += at[t];
      q += at[t] * at[t];
    }
    const auto channel = static_cast<std::size_t>(first + c);
    const double mean = x.mean[channel];
    y.mean += w * mean;
    y.variance += q * x.variance[channel];
    y.own += (q * x.square(channel) + w * w * mean * mean + q * x.variance[channel]) / 2;
  }
  return y;
}

void apply(const UnaryOp& function, Channel& y) {
  const FunctionStatistics f = function.statistics_at(y.mean, y.variance);
  y.mean = f.mean;
  y.variance = f.variance;
  y.own *= f.square_of_slope;
}

/// elu(a) · sigmoid(b), both independent.
Channel gated(const Channel& a, const Channel& b) {
  const FunctionStatistics feature = UnaryOp(UnaryKind::kElu, 1).statistics_at(a.mean, a.variance);
  const FunctionStatistics gate = UnaryOp(UnaryKind::kSigmoid).statistics_at(b.mean, b.variance);
  const double feature_square = feature.mean * feature.mean + feature.variance;
  const double gate_square = gate.mean * gate.mean + gate.variance;
  Channel y;
  y.mean = feature.mean * gate.mean;
  y.variance = std::max(0.0, feature_square * gate_square - y.mean * y.mean);
  y.own = a.own * feature.square_of_slope * gate_square + b.own * gate.square_of_slope * feature_square;
  return y;
}

}  // namespace

NodeStatistics Conv2dOp::statistics(const StatisticsCall& call) const {
  const Conv2dGeometry g = geometry(call.shapes);
  const bool biased = g.has_bias && !call.constants[2].empty();
  if (call.constants[1].empty() || g.has_bias != biased) return handed_on(*this, call);
  const ValueStatistics x = convolved(fusion_, call);
  const double* weight = call.constants[1].data<double>().data();
  std::vector<Channel> y(static_cast<std::size_t>(g.oc));
  parallel_for(g.oc, [&](std::int64_t o) {
    const auto at = static_cast<std::size_t>(o);
    y[at] = sums_of(g, o, x, weight, biased ? call.constants[2].data<double>()[at] : 0);
  });
  const std::size_t channels = static_cast<std::size_t>(fusion_.gate ? g.oc / 2 : g.oc);
  if (fusion_.gate)
    for (std::size_t c = 0; c < channels; ++c) y[c] = gated(y[c], y[c + channels]);
  y.resize(channels);

  const auto add_residual = [&](Channel& to, std::size_t c) {
    const ValueStatistics& residual = call.inputs[3];
    if (residual.channels() == 0) return;  // a constant
    to.mean += residual.mean[c];
    to.variance += residual.variance[c];
  };
  NodeStatistics result;
  double own = 0;
  for (std::size_t c = 0; c < channels; ++c) {
    if (fusion_.residual && !fusion_.residual_last) add_residual(y[c], c);
    if (fusion_.activation) apply(*fusion_.activation, y[c]);
    if (fusion_.residual && fusion_.residual_last) add_residual(y[c], c);
    result.output.mean.push_back(y[c].mean);
    result.output.variance.push_back(y[c].variance);
    own += y[c].own / static_cast<double>(channels);
  }
  // Kernels take a residual to be as large as the sums.
  result.own = (fusion_.residual ? 2 : 1) * relative_square(own, result.output.square());
  return result;
}

}  // namespace slide::ops
