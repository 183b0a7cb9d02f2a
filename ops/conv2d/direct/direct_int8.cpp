// What direct convolutions of 8-bit integers are measured against.

#include <algorithm>
#include <cmath>
#include <vector>

#include "ops/conv2d/conv2d_op.h"
#include "ops/conv2d/direct/direct.h"
#include "ops/conv2d/few_filters/few_filters.h"

namespace slide::ops {

bool Conv2dDirectInt8::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return Conv2dDirectLow::fits(g, fusion) && g.group_ic >= 8 && !Conv2dFewFilters::beats_lower(g, fusion);
}

void Conv2dDirectInt8::error_scale(const Conv2dGeometry& g, std::span<const Tensor> inputs, const Tensor& x,
                                   std::span<double> scale) {
  std::vector<Tensor> wide;
  for (const Tensor& t : inputs) {
    wide.push_back(t.clone());
    for (double& v : wide.back().mutable_data<double>()) v = std::fabs(v);
  }
  std::vector<double> products(scale.size());
  conv2d_reference(g, wide, products);
  double low = 0;
  double high = 0;
  const auto image = static_cast<std::size_t>(x.count() / x.shape()[0]);
  for (std::size_t n = 0; n < static_cast<std::size_t>(x.count()); n += image) {
    const std::span<const double> values = x.data<double>().subspan(n, image);
    if (!std::ranges::all_of(values, [](double v) { return std::isfinite(v); })) continue;  // as in a run
    low = std::min(low, *std::ranges::min_element(values));
    high = std::max(high, *std::ranges::max_element(values));
  }
  for (double& v : wide[0].mutable_data<double>()) v += 1.001 * (high - low) / 255 / 2;
  const std::span<double> w = wide[1].mutable_data<double>();
  const auto depth = static_cast<std::size_t>(g.depth());
  for (std::size_t o = 0; o < w.size(); o += depth) {
    const double largest = *std::max_element(w.begin() + static_cast<std::ptrdiff_t>(o),
                                             w.begin() + static_cast<std::ptrdiff_t>(o + depth));
    for (std::size_t k = o; k < o + depth; ++k) w[k] += 1.001 * largest / 127 / 2;
  }
  conv2d_reference(g, wide, scale);
  for (std::size_t i = 0; i < scale.size(); ++i) scale[i] += 0x1p-22 * scale[i] - products[i] + 0x1p-100;
}

}  // namespace slide::ops
