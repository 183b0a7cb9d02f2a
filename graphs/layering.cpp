#include "graphs/layering.h"

#include <cmath>
#include <string>

#include "graphs/neighbourhood.h"
#include "ops/layering/layering.h"
#include "ops/pointwise/pointwise.h"
#include "ops/tensor_shape/tensor_shape.h"
#include "runtime/error.h"

namespace slide::graphs {
namespace {

constexpr double kHoleThreshold = 0.05;

void require_within(const char* name, double value, double largest) {
  if (!(value >= 0 && value <= largest))
    throw Error(ErrorKind::kUsage,
                std::string("the layering parameter ") + name + " is " + std::to_string(value),
                "give a number from 0 to " + std::to_string(largest));
}

/// relu(tanh(gamma · x))
Value soften(Value x, double gamma) { return ops::relu(ops::tanh(ops::affine(x, gamma, 0))); }

}  // namespace

Layering resolve(const LayeringParams& p) {
  require_within("parallax", p.parallax, kLargestLength);
  Layering l{};
  l.parallax = p.parallax;
  l.beta = p.beta.value_or(p.parallax * p.parallax / 12);
  l.gamma = p.gamma.value_or(p.parallax);
  l.rho = p.rho.value_or(p.parallax > 0 ? 1 / p.parallax : 0);
  l.radius = p.radius.value_or(static_cast<std::int64_t>(std::ceil(p.parallax)));
  l.sigma = p.sigma;
  l.maxpool = p.maxpool;
  require_within("beta", l.beta, kLargestBeta);
  require_within("gamma", l.gamma, kLargestGamma);
  require_within("rho", l.rho, kLargestRho);
  require_within("radius", static_cast<double>(l.radius), kLargestLength);
  require_within("sigma", l.sigma, kLargestLength);
  require_within("maxpool", static_cast<double>(l.maxpool), kLargestLength);
  if (l.maxpool % 2 == 0)
    throw Error(ErrorKind::kUsage, "the layering parameter maxpool is " + std::to_string(l.maxpool),
                "give an odd number >= 1");
  return l;
}

Value condition_disparity(Value disparity, const Layering& layering) {
  return largest_around(ops::gaussian_blur(disparity, layering.sigma), layering.maxpool / 2);
}

Value visibility(Value conditioned, const Layering& layering) {
  const Value gradient = ops::sobel(conditioned);
  const Value squared = ops::mul(gradient, gradient);
  const Value steepness = ops::add(ops::slice(squared, 1, 0, 1), ops::slice(squared, 1, 1, 2));
  return ops::exp(ops::affine(steepness, -layering.beta, 0));
}

Value disocclusion(Value conditioned, const Layering& layering) {
  const Value far_neighbour =
      ops::cone_dilation(ops::affine(conditioned, -1, 0), layering.rho, layering.radius);
  return soften(ops::add(conditioned, far_neighbour), layering.gamma);
}

Value occlusion(Value conditioned, const Layering& layering) {
  const Value near_neighbour = ops::cone_dilation(conditioned, layering.rho, layering.radius);
  return soften(ops::sub(near_neighbour, conditioned), layering.gamma);
}

Value matte_visibility(Value visibility, const FollowedMatte& matte) {
  return ops::add(visibility, ops::mul(matte.part, ops::sub(matte.alpha, visibility)));
}

Value matte_disocclusion(Value disocclusion, const FollowedMatte& matte) {
  const Value see_through = ops::affine(ops::greater(matte.alpha, kOpaque), -1, 1);
  return ops::maximum(disocclusion, ops::mul(matte.part, see_through));
}

Value hole(Value disocclusion) { return largest_around(ops::greater(disocclusion, kHoleThreshold), 1); }

LayeringMaps soft_layering(Value disparity, const Layering& layering,
                           const std::optional<FollowedMatte>& matte) {
  Graph& g = disparity.graph();
  const auto scope = g.scope("layering");
  const Value d1 = condition_disparity(disparity, layering);
  const Value covering = matte ? condition_disparity(matte->opaque, layering) : d1;
  Value s = disocclusion(covering, layering);
  const Value s_hat = occlusion(covering, layering);
  Value a = visibility(d1, layering);
  if (matte && layering.parallax > 0) {
    const FollowedMatte grown{matte->alpha, largest_around(matte->part, layering.maxpool / 2),
                              matte->opaque};  // as D1 is
    a = matte_visibility(a, grown);
    s = matte_disocclusion(s, grown);
  }
  return {d1, a, s, s_hat, hole(s)};
}

}  // namespace slide::graphs
