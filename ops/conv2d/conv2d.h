#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "runtime/graph.h"

namespace slide::ops {

/// The attributes of a two-dimensional convolution. Pairs are (vertical, horizontal).
struct Conv2dParams {
  std::array<std::int64_t, 2> stride{1, 1};
  std::array<std::int64_t, 4> padding{0, 0, 0, 0};  ///< zeros added: top, left, bottom, right
  std::array<std::int64_t, 2> dilation{1, 1};
  std::int64_t groups = 1;

  /// Equal strides and dilations in both directions and the padding that keeps the size at stride 1:
  /// dilation·(kernel-1)/2 on all sides, for odd kernels. The usual layer of a network.
  static Conv2dParams same(std::int64_t kernel, std::int64_t stride = 1, std::int64_t dilation = 1,
                           std::int64_t groups = 1);
};

/// Cross-correlation, as every deep-learning framework calls convolution:
///   y[n,o,i,j] = b[o] + sum over c,u,v of w[o,c,u,v] · x[n, g·C/groups + c, i·stride+u·dilation-top, ...],
/// g the group of o, x zero outside.
/// @param x       N×C×H×W
/// @param weight  O×(C/groups)×KH×KW, PyTorch's order
/// @param bias    O, or nothing
/// @return N×O×OH×OW with OH = floor((H + top + bottom - dilation·(KH-1) - 1) / stride) + 1
/// Throws Error(kInternal) naming the layer and the shapes that do not fit.
Value conv2d(Value x, Value weight, std::optional<Value> bias, const Conv2dParams& params);

}  // namespace slide::ops
