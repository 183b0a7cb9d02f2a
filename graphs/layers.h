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

/// torch.nn.LayerNorm over the channels (axis 1): parameters `name`.weight and .bias.
Value layer_norm(Value x, std::string_view name, double eps);

/// torch.nn.Linear of tokens, N×C×1×T: parameters `name`.weight, features × C, and `name`.bias. It is a 1×1
/// convolution of the tokens.
Value linear(Value tokens, std::string_view name, std::int64_t features);

/// The same, its result multiplied by the parameter `gamma` (a LayerScale behind it): weight and bias are, so
/// that at each run it costs nothing.
Value scaled_linear(Value tokens, std::string_view name, std::int64_t features, std::string_view gamma);

/// torch.nn.ConvTranspose2d whose kernel and stride are both `factor`: parameters `name`.weight, C × filters
/// × factor × factor, and `name`.bias. Each input pixel becomes factor × factor pixels, so it is a 1×1
/// convolution and a move of its channels into space.
Value conv_transpose2d(Value x, std::string_view name, std::int64_t filters, std::int64_t factor);

/// A network works on 1×channels×H×W with both sides multiples of `multiple`. Throws Error(kUsage) naming the
/// network and the shape it was given otherwise.
void require_image(std::string_view network, Value x, std::int64_t channels, std::int64_t multiple);

/// Gives a value the tap `name` and returns it.
Value tapped(std::string_view name, Value x);

}  // namespace slide::graphs
