// The fused convolution, defined as the composition of its parts.

#include "ops/conv2d/conv2d_op.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "ops/common/op_support.h"
#include "ops/pointwise/unary_row.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

double elu(double x) { return x < 0 ? std::expm1(x) : x; }
double sigmoid(double x) { return 1 / (1 + std::exp(-x)); }
double log_sigmoid(double x) { return x < -40 ? x : -std::log1p(std::exp(-x)); }

/// Calls body(a, g, y) for each element of a gated output, with the indices of its feature and its gate in
/// the convolution's result and its own.
template <typename Body>
void for_each_gate(const Conv2dGeometry& g, const Body& body) {
  const std::int64_t half = g.oc / 2 * g.oplane();
  parallel_for(g.batch, [&](std::int64_t n) {
    for (std::int64_t i = 0; i < half; ++i) {
      const auto a = static_cast<std::size_t>(2 * n * half + i);
      body(a, a + static_cast<std::size_t>(half), static_cast<std::size_t>(n * half + i));
    }
  });
}

/// x enlarged by 2: sample i is far · (1 - near_weight) + near · near_weight of the samples at i / 2 and
/// beside it, on i's side.
Tensor upsampled(const Tensor& x, double near_weight) {
  const Shape& s = x.shape();
  Tensor y(DType::kF64, {s[0], s[1], 2 * s[2], 2 * s[3]});
  const double* plane = x.data<double>().data();
  double* to = y.mutable_data<double>().data();
  const auto blend = [=](double near, double far) {  // infinity times zero is no number
    return near_weight == 1 ? near : near_weight * near + (1 - near_weight) * far;
  };
  const auto far = [](std::int64_t i, std::int64_t extent) {
    return std::clamp<std::int64_t>(i / 2 + (i % 2 == 0 ? -1 : 1), 0, extent - 1);
  };
  for (std::int64_t n = 0; n < s[0] * s[1]; ++n, plane += s[2] * s[3])
    for (std::int64_t i = 0; i < 2 * s[2]; ++i)
      for (std::int64_t j = 0; j < 2 * s[3]; ++j) {
        const auto row = [&](std::int64_t k) {
          const double* at = plane + k * s[3];
          return blend(at[j / 2], at[far(j, s[3])]);
        };
        *to++ = blend(row(i / 2), row(far(i, s[2])));
      }
  return y;
}

/// The channels of x, then those of `joined`.
Tensor with_channels(const Tensor& x, const Tensor& joined) {
  const Shape &s = x.shape(), &t = joined.shape();
  Tensor y(DType::kF64, s.with(1, s[1] + t[1]));
  const double *from = x.data<double>().data(), *behind = joined.data<double>().data();
  double* to = y.mutable_data<double>().data();
  const std::int64_t count = s[1] * s[2] * s[3], joined_count = t[1] * t[2] * t[3];
  for (std::int64_t n = 0; n < s[0]; ++n) {
    to = std::copy_n(from + n * count, count, to);
    to = std::copy_n(behind + n * joined_count, joined_count, to);
  }
  return y;
}

}  // namespace

std::string text_of(const Conv2dFusion& fusion) {
  std::string text;
  const auto append = [&](const std::string& part) { text += (text.empty() ? "" : ", ") + part; };
  if (fusion.upsamples())
    append(fusion.upsample_input == Upsampling::kNearest ? "x2 before" : "bilinear x2 before");
  if (fusion.joined > 0) append(std::to_string(fusion.joined) + " channels joined");
  if (fusion.relu_input) append("relu before");
  if (fusion.residual && !fusion.residual_last) append("residual");
  if (fusion.gate) append("gate");
  if (fusion.activation) append(std::string(fusion.activation->type()));
  if (fusion.residual && fusion.residual_last) append("residual");
  return text;
}

std::vector<Shape> shapes_of(std::span<const Tensor> tensors) {
  std::vector<Shape> shapes;
  shapes.reserve(tensors.size());
  for (const Tensor& t : tensors) shapes.push_back(t.shape());
  return shapes;
}

std::string_view Conv2dOp::type() const { return fusion_.gate ? "gated_conv2d" : "conv2d"; }

std::string Conv2dOp::attributes() const {
  Conv2dFusion shown = fusion_;
  shown.gate = false;  // the type says it
  const std::string fused = text_of(shown);
  const std::string plain = text_of(params_);
  return fused.empty() || plain.empty() ? plain + fused : plain + ", " + fused;
}

Conv2dGeometry Conv2dOp::geometry(std::span<const Shape> inputs) const {
  std::vector<Shape> own(inputs.begin(), inputs.end());
  const std::size_t fused = (fusion_.residual ? 1 : 0) + (fusion_.joined > 0 ? 1 : 0);
  if (fused > 0) {
    require_input_count(type(), inputs, 3 + fused, 3 + fused);
    own.resize(3);
  }
  if (fusion_.upsamples() && own[0].rank() == 4)
    own[0] = own[0].with(2, 2 * own[0][2]).with(3, 2 * own[0][3]);
  if (fusion_.joined > 0 && own[0].rank() == 4) {
    require_shape("joined tensor", inputs.back(), own[0].with(1, fusion_.joined));
    own[0] = own[0].with(1, own[0][1] + fusion_.joined);
  }
  const Conv2dGeometry g = conv2d_geometry(type(), own, params_);
  if (fusion_.gate && g.oc % 2 != 0)
    throw shape_error("a gated convolution needs an even number of filters, the weight has shape " +
                      inputs[1].text());
  return g;
}

Shape Conv2dOp::infer(std::span<const Shape> inputs) const {
  const Conv2dGeometry g = geometry(inputs);
  Shape output = g.output();
  if (fusion_.gate) output = output.with(1, g.oc / 2);
  if (fusion_.residual) require_shape("residual", inputs[3], output);
  return output;
}

double Conv2dOp::error_share(std::size_t index, std::span<const Shape> inputs) const {
  const double sums = fusion_.residual ? 0.5 : 1;
  if (fusion_.residual && index == 3) return 0.5;
  const double joined =
      static_cast<double>(fusion_.joined) / static_cast<double>(inputs[0][1] + fusion_.joined);
  if (index == 0) return sums * (1 - joined);
  return fusion_.joined > 0 && index + 1 == inputs.size() ? sums * joined : 0;
}

double Conv2dOp::macs(std::span<const Shape> inputs, const Shape& output) const {
  return (fusion_.gate ? 2 : 1) * static_cast<double>(output.count()) *
         static_cast<double>(geometry(inputs).depth());
}

std::vector<Tensor> Conv2dOp::convolution_inputs(std::span<const Tensor> inputs) const {
  std::vector<Tensor> own(inputs.begin(), inputs.begin() + std::min<std::ptrdiff_t>(3, std::ssize(inputs)));
  if (fusion_.upsamples())
    own[0] = upsampled(own[0], fusion_.upsample_input == Upsampling::kNearest ? 1 : 0.75);
  if (fusion_.joined > 0) own[0] = with_channels(own[0], inputs.back());
  if (fusion_.relu_input) {
    own[0] = own[0].clone();
    for (double& v : own[0].mutable_data<double>()) v = v < 0 ? 0 : v;
  }
  return own;
}

std::vector<Tensor> Conv2dOp::scale_inputs(std::span<const Tensor> inputs) const {
  if (fusion_.upsample_input != Upsampling::kBilinear) return convolution_inputs(inputs);
  std::vector<Tensor> absolute(inputs.begin(), inputs.end());
  absolute[0] = absolute[0].clone();
  for (double& v : absolute[0].mutable_data<double>()) v = std::fabs(v);
  return convolution_inputs(absolute);
}

void Conv2dOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const Conv2dGeometry g = geometry(shapes_of(inputs));
  const std::vector<Tensor> own = convolution_inputs(inputs);
  const std::span<double> y = output.mutable_data<double>();
  if (fusion_.gate) {
    std::vector<double> conv(static_cast<std::size_t>(g.output().count()));
    conv2d_reference(g, own, conv);
    for_each_gate(g, [&](std::size_t feature, std::size_t gate, std::size_t i) {
      y[i] = elu(conv[feature]) * sigmoid(conv[gate]);
    });
  } else {
    conv2d_reference(g, own, y);
  }
  const auto add_residual = [&] {
    for (std::size_t i = 0; i < y.size(); ++i) y[i] += inputs[3].data<double>()[i];
  };
  if (fusion_.residual && !fusion_.residual_last) add_residual();
  if (fusion_.activation)
    for (double& v : y) v = fusion_.activation->evaluate(v);
  if (fusion_.residual && fusion_.residual_last) add_residual();
}

void Conv2dOp::error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const {
  const Conv2dGeometry g = geometry(shapes_of(inputs));
  std::vector<double> sums(static_cast<std::size_t>(g.output().count()));
  conv2d_error_scale(g, scale_inputs(inputs), sums);
  error_scale_of_sums(inputs, sums, output, scale);
}

void Conv2dOp::error_scale_of_sums(std::span<const Tensor> inputs, std::span<const double> sums,
                                   const Tensor& output, Tensor& scale, double rounding,
                                   double largest) const {
  const std::span<const double> y = output.data<double>();
  const std::span<double> s = scale.mutable_data<double>();
  if (fusion_.gate) {
    const Conv2dGeometry g = geometry(shapes_of(inputs));
    std::vector<double> conv(sums.size());
    conv2d_reference(g, convolution_inputs(inputs), conv);
    for_each_gate(g, [&](std::size_t feature, std::size_t gate, std::size_t i) {
      const double open = std::exp(std::min(0.0, log_sigmoid(conv[gate]) + largest * sums[gate]));
      const double feature_size = std::fabs(elu(conv[feature]));
      s[i] = sums[feature] * open + feature_size * sums[gate] * std::min(0.25, open) +
             rounding * std::fabs(y[i]) + 0x1p-102 * (1 + feature_size);
    });
  } else {
    std::copy(sums.begin(), sums.end(), s.begin());
  }
  const auto residual = [&](std::size_t i) {
    return fusion_.residual ? rounding * std::fabs(inputs[3].data<double>()[i]) : 0;
  };
  // Behind the activation |y| + |residual| bounds what the activation gave.
  const double slope = fusion_.activation ? activation_slope(*fusion_.activation).value_or(1.0) : 1;
  for (std::size_t i = 0; i < s.size(); ++i) {
    if (!fusion_.residual_last) s[i] += residual(i);
    if (fusion_.activation) s[i] = s[i] * slope + rounding * std::fabs(y[i]);
    if (fusion_.residual_last) s[i] += residual(i);
  }
}

}  // namespace slide::ops
