#include "graphs/neighbourhood.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "ops/pointwise/pointwise.h"
#include "ops/pool/pool.h"
#include "ops/resize/resize.h"
#include "runtime/shape.h"

namespace slide::graphs {
namespace {

Value negated(Value x) { return ops::affine(x, -1, 0); }

ops::PoolParams window(std::int64_t r) {
  return {.kernel = {2 * r + 1, 2 * r + 1}, .stride = {1, 1}, .padding = {r, r, r, r}};
}

}  // namespace

Value largest_around(Value x, std::int64_t radius) { return ops::max_pool2d(x, window(radius)); }

Value least_around(Value x, std::int64_t radius) { return negated(largest_around(negated(x), radius)); }

Value mean_around(Value x, std::int64_t radius) { return ops::avg_pool2d(x, window(radius)); }

Value smooth_mean(Value x, std::int64_t radius) {
  const std::int64_t cell = std::max<std::int64_t>(1, radius / 4);
  const Value cells = ops::avg_pool2d(
      x, {.kernel = {cell, cell}, .stride = {cell, cell}, .ceil_mode = true, .count_include_pad = false});
  const Value mean = mean_around(cells, radius / cell);
  const auto scale = static_cast<double>(cell);
  return ops::resize(mean, {.mode = ops::ResizeMode::kLinear,
                            .size = {x.shape()[2], x.shape()[3]},
                            .scale = std::array<double, 2>{scale, scale}});
}

Value smoothstep(Value x, double from, double to) {
  const Value t = ops::clip(ops::affine(x, 1 / (to - from), -from / (to - from)), 0, 1);
  return ops::mul(ops::mul(t, t), ops::affine(t, -2, 3));
}

std::int64_t pixels_of(Value map, double part) {
  const auto longer = static_cast<double>(std::max(map.shape()[2], map.shape()[3]));
  return static_cast<std::int64_t>(std::round(part * longer));
}

}  // namespace slide::graphs
