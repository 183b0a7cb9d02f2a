#include "graphs/lpips.h"

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "ops/conv2d/conv2d.h"
#include "ops/pointwise/pointwise.h"
#include "ops/pool/pool.h"
#include "ops/reduce/reduce.h"
#include "runtime/error.h"

namespace slide::graphs {
namespace {

/// Smaller pictures leave nothing of the last pooling.
constexpr std::int64_t kLeastSide = 63;
constexpr double kLengthEps = 1e-10;

/// The scaling layer: (2x - 1 - shift) / scale.
constexpr std::array kShift = {-0.030, -0.088, -0.188};
constexpr std::array kScale = {0.458, 0.448, 0.450};

/// A convolution with ReLU, a max-pool of 3 with stride 2 before it or not.
struct Layer {
  std::string_view name, head;
  std::int64_t filters, kernel, stride, padding;
  bool pooled;
};
constexpr std::array<Layer, 5> kLayers = {{{"net.slice1.0", "lin0.model.1", 64, 11, 4, 2, false},
                                           {"net.slice2.3", "lin1.model.1", 192, 5, 1, 2, true},
                                           {"net.slice3.6", "lin2.model.1", 384, 3, 1, 1, true},
                                           {"net.slice4.8", "lin3.model.1", 256, 3, 1, 1, false},
                                           {"net.slice5.10", "lin4.model.1", 256, 3, 1, 1, false}}};

Value channel_constant(Graph& g, std::string_view name, const std::array<double, 3>& values) {
  Tensor t(DType::kF64, {1, 3, 1, 1});
  std::ranges::copy(values, t.mutable_data<double>().begin());
  return g.constant(name, t);
}

/// Both pictures as the network takes them.
void scale(Value& a, Value& b) {
  std::array<double, 3> shift{};
  std::array<double, 3> factor{};
  for (std::size_t c = 0; c < 3; ++c) {
    factor[c] = 2 / kScale[c];
    shift[c] = (-1 - kShift[c]) / kScale[c];
  }
  const Value factors = channel_constant(a.graph(), "factor", factor);
  const Value shifts = channel_constant(a.graph(), "shift", shift);
  for (Value* x : {&a, &b}) *x = ops::add(ops::mul(*x, factors), shifts);
}

Value features(Value x, const Layer& layer) {
  Graph& g = x.graph();
  if (layer.pooled) x = ops::max_pool2d(x, {.kernel = {3, 3}, .stride = {2, 2}});
  const std::string name(layer.name);
  const Value weight =
      g.parameter(name + ".weight", {layer.filters, x.shape()[1], layer.kernel, layer.kernel});
  const Value bias = g.parameter(name + ".bias", {layer.filters});
  const std::int64_t p = layer.padding;
  return ops::relu(
      ops::conv2d(x, weight, bias, {.stride = {layer.stride, layer.stride}, .padding = {p, p, p, p}}));
}

/// x over its length at each pixel.
Value unit(Value x) {
  const auto channels = static_cast<double>(x.shape()[1]);
  const Value squares = ops::affine(ops::reduce_mean(ops::mul(x, x), {1}), channels, 0);
  return ops::div(x, ops::affine(ops::sqrt(squares), 1, kLengthEps));
}

}  // namespace

Value lpips_alex(Value a, Value b) {
  const Shape& s = a.shape();
  if (s != b.shape() || s.rank() != 4 || s[0] != 1 || s[1] != 3 || s[2] < kLeastSide || s[3] < kLeastSide)
    throw Error(ErrorKind::kUsage,
                "LPIPS compares two pictures 1x3xHxW of one size, at least 63 pixels a side; "
                "these are " +
                    s.text() + " and " + b.shape().text());
  Graph& g = a.graph();
  scale(a, b);
  std::optional<Value> sum;
  for (const Layer& layer : kLayers) {
    a = features(a, layer);
    b = features(b, layer);
    const Value difference = ops::sub(unit(a), unit(b));
    const Value head = g.parameter(std::string(layer.head) + ".weight", {1, layer.filters, 1, 1});
    const Value distance =
        ops::global_avg_pool2d(ops::conv2d(ops::mul(difference, difference), head, std::nullopt, {}));
    sum = sum ? ops::add(*sum, distance) : distance;
  }
  return *sum;
}

}  // namespace slide::graphs
