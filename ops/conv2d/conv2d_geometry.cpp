#include "ops/conv2d/conv2d_geometry.h"

#include <algorithm>
#include <string>

#include "ops/common/op_support.h"

namespace slide::ops {
namespace {

/// Attributes up to here cannot overflow the 64-bit arithmetic on positions.
constexpr std::int64_t kLargest = std::int64_t{1} << 30;

void require_between(std::string_view what, std::int64_t value, std::int64_t least) {
  require_at_least(what, value, least);
  if (value > kLargest)
    throw shape_error("the " + std::string(what) + " is " + std::to_string(value) + ", at most " +
                      std::to_string(kLargest) + " is possible");
}

std::int64_t output_extent(std::string_view axis, std::int64_t input, std::int64_t before, std::int64_t after,
                           std::int64_t kernel, std::int64_t stride, std::int64_t dilation) {
  require_between("input's " + std::string(axis), input, 1);
  require_between("kernel's " + std::string(axis), kernel, 1);
  const std::int64_t padded = input + before + after;
  const std::int64_t reach = dilation * (kernel - 1) + 1;
  if (padded < reach)
    throw shape_error("the kernel's " + std::string(axis) + " reaches over " + std::to_string(reach) +
                      ", the padded input has " + std::to_string(padded));
  return (padded - reach) / stride + 1;
}

void check_params(const Conv2dParams& params) {
  for (const std::int64_t s : params.stride) require_between("stride", s, 1);
  for (const std::int64_t d : params.dilation) require_between("dilation", d, 1);
  for (const std::int64_t p : params.padding) require_between("padding", p, 0);
  require_between("number of groups", params.groups, 1);
}

}  // namespace

Conv2dGeometry conv2d_geometry(std::string_view op, std::span<const Shape> inputs,
                               const Conv2dParams& params) {
  require_input_count(op, inputs, 2, 3);
  require_rank("input", inputs[0], 4);
  require_rank("weight", inputs[1], 4);
  check_params(params);
  const Shape& x = inputs[0];
  const Shape& w = inputs[1];
  Conv2dGeometry g{};
  g.batch = x[0];
  g.ic = x[1];
  g.height = x[2];
  g.width = x[3];
  g.oc = w[0];
  g.kheight = w[2];
  g.kwidth = w[3];
  g.groups = params.groups;
  g.group_ic = g.ic / g.groups;
  g.group_oc = g.oc / g.groups;
  g.stride_y = params.stride[0];
  g.stride_x = params.stride[1];
  g.dilation_y = params.dilation[0];
  g.dilation_x = params.dilation[1];
  g.top = params.padding[0];
  g.left = params.padding[1];
  g.has_bias = inputs.size() == 3;
  if (g.ic < 1 || g.oc < 1 || g.ic % g.groups != 0 || g.oc % g.groups != 0 || w[1] != g.group_ic)
    throw shape_error("an input of shape " + x.text() + " and a weight of shape " + w.text() + " with " +
                      std::to_string(g.groups) + " groups do not fit");
  if (g.has_bias) require_shape("bias", inputs[2], Shape{g.oc});
  g.oheight =
      output_extent("height", g.height, g.top, params.padding[2], g.kheight, g.stride_y, g.dilation_y);
  g.owidth = output_extent("width", g.width, g.left, params.padding[3], g.kwidth, g.stride_x, g.dilation_x);
  return g;
}

bool reads_once(const Conv2dGeometry& g) noexcept {
  return g.kheight == 1 && g.kwidth == 1 && g.stride_y == 1 && g.stride_x == 1 && g.oheight == g.height &&
         g.owidth == g.width && g.top == 0 && g.left == 0;
}

Conv2dGeometry with_rows_joined(Conv2dGeometry g) noexcept {
  if (!reads_once(g)) return g;
  g.width = g.owidth = g.plane();
  g.height = g.oheight = 1;
  return g;
}

std::int64_t filter_of_row(const Conv2dGeometry& g, bool gated, std::int64_t group,
                           std::int64_t row) noexcept {
  if (!gated) return group * g.group_oc + row;
  return row / 2 + (row % 2 == 0 ? 0 : g.oc / 2);
}

TapRange tap_range(std::int64_t offset, std::int64_t stride, std::int64_t extent,
                   std::int64_t output_extent) noexcept {
  const std::int64_t first = offset >= 0 ? 0 : (-offset + stride - 1) / stride;
  const std::int64_t last = offset >= extent ? 0 : (extent - 1 - offset) / stride + 1;
  return {std::min(first, output_extent), std::clamp(last, std::min(first, output_extent), output_extent)};
}

}  // namespace slide::ops
