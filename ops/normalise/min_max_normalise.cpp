#include <algorithm>
#include <cmath>
#include <limits>

#include "ops/common/elements.h"
#include "ops/normalise/normalise.h"
#include "ops/normalise/normalise_ops.h"

namespace slide::ops {

bool without_relief(double least, double largest) noexcept {
  return largest - least <= 1e-6 * std::max(1.0, std::fabs(largest));
}

Shape MinMaxNormaliseOp::infer(std::span<const Shape> inputs) const {
  require_input_count("min_max_normalise", inputs, 1, 1);
  require(inputs[0].count() > 0, "min_max_normalise was given a tensor without elements");
  return inputs[0];
}

void MinMaxNormaliseOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const std::span<const double> x = inputs[0].data<double>();
  const std::span<double> y = output.mutable_data<double>();
  if (!std::all_of(x.begin(), x.end(), [](double v) { return std::isfinite(v); })) {
    std::fill(y.begin(), y.end(), std::numeric_limits<double>::quiet_NaN());
    return;
  }
  const auto [least, largest] = std::minmax_element(x.begin(), x.end());
  if (without_relief(*least, *largest)) {
    std::fill(y.begin(), y.end(), 0.0);
    return;
  }
  for (std::size_t i = 0; i < x.size(); ++i) y[i] = (x[i] - *least) / (*largest - *least);
}

Value min_max_normalise(Value x) { return x.graph().add(std::make_shared<MinMaxNormaliseOp>(), {x}); }

}  // namespace slide::ops
