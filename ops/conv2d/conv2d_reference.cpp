#include <algorithm>
#include <cmath>
#include <vector>

#include "ops/conv2d/conv2d_op.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

/// y[i, j] += w · x[i·stride_y + dy, j·stride_x + dx], which is 0 outside the plane x: a weight that is NaN
/// or infinite makes NaN there.
void add_tap(const Conv2dGeometry& g, double w, const double* x, std::int64_t dy, std::int64_t dx,
             double* y) {
  const TapRange rows = tap_range(dy, g.stride_y, g.height, g.oheight);
  const TapRange columns = tap_range(dx, g.stride_x, g.width, g.owidth);
  for (std::int64_t i = rows.first; i < rows.last; ++i) {
    const double* source = x + (i * g.stride_y + dy) * g.width + dx;
    double* target = y + i * g.owidth;
    if (g.stride_x == 1)
      for (std::int64_t j = columns.first; j < columns.last; ++j) target[j] += w * source[j];
    else
      for (std::int64_t j = columns.first; j < columns.last; ++j) target[j] += w * source[j * g.stride_x];
  }
  if (std::isfinite(w)) return;
  for (std::int64_t i = 0; i < g.oheight; ++i)
    for (std::int64_t j = 0; j < g.owidth; ++j)
      if (i < rows.first || i >= rows.last || j < columns.first || j >= columns.last)
        y[i * g.owidth + j] += w * 0;
}

/// One output channel of one image.
void compute_plane(const Conv2dGeometry& g, const double* x, const double* weight, double bias, double* y) {
  std::fill(y, y + g.oplane(), bias);
  for (std::int64_t c = 0; c < g.group_ic; ++c)
    for (std::int64_t u = 0; u < g.kheight; ++u)
      for (std::int64_t v = 0; v < g.kwidth; ++v)
        add_tap(g, *weight++, x + c * g.plane(), u * g.dilation_y - g.top, v * g.dilation_x - g.left, y);
}

Tensor magnitudes(const Tensor& t) {
  Tensor out(DType::kF64, t.shape());
  const std::span<const double> from = t.data<double>();
  const std::span<double> to = out.mutable_data<double>();
  for (std::size_t i = 0; i < from.size(); ++i) to[i] = std::fabs(from[i]);
  return out;
}

}  // namespace

void conv2d_reference(const Conv2dGeometry& g, std::span<const Tensor> inputs, std::span<double> y) {
  const double* x = inputs[0].data<double>().data();
  const double* weight = inputs[1].data<double>().data();
  const double* bias = g.has_bias ? inputs[2].data<double>().data() : nullptr;
  parallel_for(g.batch * g.oc, [&](std::int64_t plane) {
    const std::int64_t n = plane / g.oc;
    const std::int64_t o = plane % g.oc;
    const std::int64_t first_channel = o / g.group_oc * g.group_ic;
    compute_plane(g, x + (n * g.ic + first_channel) * g.plane(), weight + o * g.depth(),
                  bias != nullptr ? bias[o] : 0.0, y.data() + plane * g.oplane());
  });
}

void conv2d_error_scale(const Conv2dGeometry& g, std::span<const Tensor> inputs, std::span<double> scale) {
  std::vector<Tensor> absolute;
  for (const Tensor& t : inputs) absolute.push_back(magnitudes(t));
  // An operand below the normal range may be read as zero: it then counts as if it were 2^-102 large.
  for (std::size_t i = 0; i < 2; ++i)
    for (double& a : absolute[i].mutable_data<double>())
      if (a != 0) a = std::max(a, 0x1p-102);
  conv2d_reference(g, absolute, scale);
  const double underflow = 0x1p-102 * static_cast<double>(g.depth() + 1);
  for (double& s : scale) s += underflow;
}

}  // namespace slide::ops
