#include "runtime/op.h"

#include <algorithm>
#include <cmath>

namespace slide {

void Op::error_scale(std::span<const Tensor> /*inputs*/, const Tensor& output, Tensor& scale) const {
  const std::span<const double> y = output.data<double>();
  const std::span<double> s = scale.mutable_data<double>();
  for (std::size_t i = 0; i < y.size(); ++i) s[i] = std::fabs(y[i]);
}

double Op::definition_factor(std::span<const Shape> inputs, const Shape& output) const {
  return 16 + macs(inputs, output) / static_cast<double>(std::max<std::int64_t>(1, output.count()));
}

double Op::error_share(std::size_t index, std::span<const Shape> inputs) const {
  double all = 0;
  for (const Shape& shape : inputs) all += static_cast<double>(shape.count());
  return all > 0 ? static_cast<double>(inputs[index].count()) / all : 0;
}

std::string Kernel::name_and_level() const { return std::string(name()) + "." + std::string(name_of(isa())); }

double Kernel::expected_error(const Op& op, std::span<const Shape> inputs) const {
  return 0.4 * unit_roundoff() * std::sqrt(error_factor(op, inputs));
}

double Kernel::cost(const Op& op, std::span<const Shape> inputs, const Shape& output) const {
  return macs(op, inputs, output);
}

double Kernel::macs(const Op& op, std::span<const Shape> inputs, const Shape& output) const {
  return op.macs(inputs, output);
}

}  // namespace slide
