#pragma once

#include <cstdint>
#include <string_view>

#include "runtime/graph.h"

namespace slide::graphs {

/// The attributes of a convolution layer that a network file spells out; the rest follows from the input.
struct ConvLayer {
  std::int64_t filters;
  std::int64_t kernel = 3;
  std::int64_t stride = 1;
  std::int64_t dilation = 1;
  std::int64_t groups = 1;
  bool bias = true;
};

/// torch.nn.Conv2d of an odd kernel with padding dilation·(kernel-1)/2, its parameters `name`.weight and, if
/// the layer has one, `name`.bias below the scope in force.
Value conv2d(Value x, std::string_view name, const ConvLayer& layer);

/// The same with TensorFlow's "same" padding: as many zeros as make the output ceil(input / stride), the odd
/// one at the bottom and right.
Value conv2d_tf_same(Value x, std::string_view name, const ConvLayer& layer);

/// torch.nn.BatchNorm2d in eval mode: parameters `name`.weight, .bias, .running_mean, .running_var.
Value batch_norm(Value x, std::string_view name, double eps = 1e-5);

/// torch.nn.GroupNorm: parameters `name`.weight and .bias.
Value group_norm(Value x, std::string_view name, std::int64_t groups, double eps = 1e-5);

/// A network works on 1×channels×H×W with both sides multiples of `multiple`. Throws Error(kUsage) naming the
/// network and the shape it was given otherwise.
void require_image(std::string_view network, Value x, std::int64_t channels, std::int64_t multiple);

/// Gives a value the tap `name` and returns it.
Value tapped(std::string_view name, Value x);

}  // namespace slide::graphs
