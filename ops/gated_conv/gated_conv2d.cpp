#include "ops/gated_conv/gated_conv2d.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "ops/common/op_support.h"
#include "ops/conv2d/conv2d_op.h"
#include "ops/gated_conv/gated_conv2d_op.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

double elu(double x) { return x < 0 ? std::expm1(x) : x; }
double sigmoid(double x) { return 1 / (1 + std::exp(-x)); }
double log_sigmoid(double x) { return x < -40 ? x : -std::log1p(std::exp(-x)); }

/// Calls body(a, g, y) for each image's output, with the indices of its first element in the features, in the
/// gates (both in the convolution's result) and in the output.
template <typename Body>
void for_each_image(const Conv2dGeometry& g, const Body& body) {
  const std::int64_t half = g.oc / 2 * g.oplane();
  parallel_for(g.batch, [&](std::int64_t n) {
    for (std::int64_t i = 0; i < half; ++i) {
      const auto a = static_cast<std::size_t>(2 * n * half + i);
      body(a, a + static_cast<std::size_t>(half), static_cast<std::size_t>(n * half + i));
    }
  });
}

}  // namespace

Conv2dGeometry GatedConv2dOp::geometry(std::span<const Shape> inputs) const {
  const Conv2dGeometry g = conv2d_geometry(type(), inputs, params_);
  if (g.oc % 2 != 0)
    throw shape_error("a gated convolution needs an even number of filters, the weight has shape " +
                      inputs[1].text());
  return g;
}

std::string GatedConv2dOp::attributes() const { return text_of(params_); }

Shape GatedConv2dOp::infer(std::span<const Shape> inputs) const {
  const Conv2dGeometry g = geometry(inputs);
  return g.output().with(1, g.oc / 2);
}

double GatedConv2dOp::macs(std::span<const Shape> inputs, const Shape& output) const {
  return 2 * static_cast<double>(output.count()) * static_cast<double>(geometry(inputs).depth());
}

void GatedConv2dOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const Conv2dGeometry g = geometry(shapes_of(inputs));
  std::vector<double> conv(static_cast<std::size_t>(g.output().count()));
  conv2d_reference(g, inputs, conv);
  const std::span<double> y = output.mutable_data<double>();
  for_each_image(g, [&](std::size_t feature, std::size_t gate, std::size_t i) {
    y[i] = elu(conv[feature]) * sigmoid(conv[gate]);
  });
}

void GatedConv2dOp::error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const {
  const Conv2dGeometry g = geometry(shapes_of(inputs));
  std::vector<double> conv(static_cast<std::size_t>(g.output().count()));
  std::vector<double> conv_scale(conv.size());
  conv2d_reference(g, inputs, conv);
  conv2d_error_scale(g, inputs, conv_scale);
  const std::span<const double> y = output.data<double>();
  const std::span<double> s = scale.mutable_data<double>();
  for_each_image(g, [&](std::size_t feature, std::size_t gate, std::size_t i) {
    const double open = std::exp(std::min(0.0, log_sigmoid(conv[gate]) + conv_scale[gate] / 64));
    const double feature_size = std::fabs(elu(conv[feature]));
    s[i] = conv_scale[feature] * open + feature_size * conv_scale[gate] * std::min(0.25, open) +
           std::fabs(y[i]) + 0x1p-102 * (1 + feature_size);
  });
}

Value gated_conv2d(Value x, Value weight, std::optional<Value> bias, const Conv2dParams& params) {
  std::vector<Value> inputs{x, weight};
  if (bias) inputs.push_back(*bias);
  return x.graph().add(std::make_shared<GatedConv2dOp>(params), inputs);
}

}  // namespace slide::ops
