#include "ops/conv2d/winograd/winograd_error.h"

#include <cmath>
#include <vector>

#include "ops/conv2d/winograd/winograd_matrices.h"
#include "ops/conv2d/winograd/winograd_tiles.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

std::vector<std::vector<double>> magnitudes(std::vector<std::vector<double>> a) {
  for (auto& row : a)
    for (double& value : row) value = std::fabs(value);
  return a;
}

/// A X Aᵀ of n×n numbers x, for A of any number of rows.
std::vector<double> sandwich(const std::vector<std::vector<double>>& a, const std::vector<double>& x) {
  const std::size_t n = a[0].size(), m = a.size();
  std::vector<double> half(m * n), y(m * m);
  for (std::size_t i = 0; i < m; ++i)
    for (std::size_t k = 0; k < n; ++k)
      for (std::size_t j = 0; j < n; ++j) half[i * n + j] += a[i][k] * x[k * n + j];
  for (std::size_t i = 0; i < m; ++i)
    for (std::size_t k = 0; k < n; ++k)
      for (std::size_t j = 0; j < m; ++j) y[i * m + j] += half[i * n + k] * a[j][k];
  return y;
}

// Operands, products and sums below 2^-126 may be flushed to zero. u times this is 16 times that: room for
// the steps of a transform.
constexpr double kUnderflow = 0x1p-98;

}  // namespace

void winograd_error_scale(int tile, const Conv2dGeometry& g, std::span<const Tensor> inputs,
                          std::span<double> scale) {
  WinogradMatrices w = winograd_matrices(winograd_pairs(tile));
  w = {w.tile, w.frequencies, magnitudes(w.at), magnitudes(w.g), magnitudes(w.bt)};
  const auto n = static_cast<std::size_t>(w.frequencies);
  const std::size_t count = n * n;
  const std::span<const double> x = inputs[0].data<double>(), weight = inputs[1].data<double>();
  const auto filters = static_cast<std::size_t>(g.oc), channels = static_cast<std::size_t>(g.ic);
  std::vector<double> u(filters * channels * count);
  for (std::size_t i = 0; i < filters * channels; ++i) {
    double taps[9];
    for (std::size_t k = 0; k < 9; ++k) taps[k] = std::fabs(weight[i * 9 + k]);
    winograd_filters(w, taps, 1, u.data() + i * count);
    for (std::size_t f = 0; f < count; ++f) u[i * count + f] += kUnderflow;
  }
  const std::int64_t lines = tile_count(g.oheight, tile, g.dilation_y);
  const std::int64_t line_tiles = tile_count(g.owidth, tile, g.dilation_x);
  parallel_for(g.batch * lines * line_tiles, [&](std::int64_t index) {
    const std::int64_t image = index / line_tiles / lines;
    const std::int64_t row = tile_start(index / line_tiles % lines, tile, g.dilation_y);
    const std::int64_t column = tile_start(index % line_tiles, tile, g.dilation_x);
    std::vector<double> v(channels * count), d(count);
    for (std::int64_t c = 0; c < g.ic; ++c) {
      for (std::int64_t i = 0; i < w.frequencies; ++i)
        for (std::int64_t j = 0; j < w.frequencies; ++j) {
          const std::int64_t y_at = row + i * g.dilation_y - g.top, x_at = column + j * g.dilation_x - g.left;
          const bool inside = y_at >= 0 && y_at < g.height && x_at >= 0 && x_at < g.width;
          d[static_cast<std::size_t>(i * w.frequencies + j)] =
              inside
                  ? std::fabs(
                        x[static_cast<std::size_t>(((image * g.ic + c) * g.height + y_at) * g.width + x_at)])
                  : 0;
        }
      const std::vector<double> transformed = sandwich(w.bt, d);
      for (std::size_t f = 0; f < count; ++f)
        v[static_cast<std::size_t>(c) * count + f] = transformed[f] + kUnderflow;
    }
    for (std::int64_t o = 0; o < g.oc; ++o) {
      std::vector<double> m(count, kUnderflow);
      for (std::size_t i = 0; i < channels * count; ++i)
        m[i % count] += u[static_cast<std::size_t>(o) * channels * count + i] * v[i];
      const std::vector<double> y = sandwich(w.at, m);
      const double bias = g.has_bias ? std::fabs(inputs[2].data<double>()[static_cast<std::size_t>(o)]) : 0;
      for (std::int64_t i = 0; i < tile; ++i)
        for (std::int64_t j = 0; j < tile; ++j) {
          const std::int64_t orow = row + i * g.dilation_y, ocolumn = column + j * g.dilation_x;
          if (orow >= g.oheight || ocolumn >= g.owidth) continue;
          scale[static_cast<std::size_t>(((image * g.oc + o) * g.oheight + orow) * g.owidth + ocolumn)] =
              y[static_cast<std::size_t>(i * tile + j)] + bias + kUnderflow;
        }
    }
  });
}

}  // namespace slide::ops
