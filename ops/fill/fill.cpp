#include "ops/fill/fill.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "ops/common/elements.h"
#include "ops/fill/fill_op.h"

namespace slide::ops {
namespace {

/// One plane of values or weights.
struct Plane {
  std::int64_t h, w;
  std::vector<double> v;

  Plane(std::int64_t height, std::int64_t width) : h(height), w(width), v(static_cast<std::size_t>(h * w)) {}
  double& at(std::int64_t i, std::int64_t j) { return v[static_cast<std::size_t>(i * w + j)]; }
  [[nodiscard]] double at(std::int64_t i, std::int64_t j) const {
    return v[static_cast<std::size_t>(i * w + j)];
  }
  /// The border replicated.
  [[nodiscard]] double near(std::int64_t i, std::int64_t j) const {
    return at(std::clamp<std::int64_t>(i, 0, h - 1), std::clamp<std::int64_t>(j, 0, w - 1));
  }
};

/// Cell (i, j) of B applied to f.
template <typename F>
double halved(const Plane& like, std::int64_t i, std::int64_t j, F f) {
  double sum = 0;
  for (std::int64_t u = 0; u < 4; ++u)
    for (std::int64_t v = 0; v < 4; ++v) {
      const std::int64_t y = 2 * i - 1 + u;
      const std::int64_t x = 2 * j - 1 + v;
      if (y >= 0 && y < like.h && x >= 0 && x < like.w) sum += kPull[u] * kPull[v] * f(y, x);
    }
  return sum;
}

/// Bilinear with half-pixel centres, the border replicated.
double enlarged(const Plane& small, std::int64_t i, std::int64_t j, std::int64_t h, std::int64_t w) {
  const double y =
      (static_cast<double>(i) + 0.5) * static_cast<double>(small.h) / static_cast<double>(h) - 0.5;
  const double x =
      (static_cast<double>(j) + 0.5) * static_cast<double>(small.w) / static_cast<double>(w) - 0.5;
  const auto top = static_cast<std::int64_t>(std::floor(y));
  const auto left = static_cast<std::int64_t>(std::floor(x));
  const double ty = y - std::floor(y);
  const double tx = x - std::floor(x);
  return (1 - ty) * ((1 - tx) * small.near(top, left) + tx * small.near(top, left + 1)) +
         ty * ((1 - tx) * small.near(top + 1, left) + tx * small.near(top + 1, left + 1));
}

Plane fill(const Plane& x, const Plane& weight, int sweeps) {
  if (x.h == 1 && x.w == 1) return x;
  Plane coarse((x.h + 1) / 2, (x.w + 1) / 2);
  Plane coarse_weight(coarse.h, coarse.w);
  for (std::int64_t i = 0; i < coarse.h; ++i)
    for (std::int64_t j = 0; j < coarse.w; ++j) {
      const double mean = halved(x, i, j, [&](auto u, auto v) { return weight.at(u, v); });
      const double sum = halved(x, i, j, [&](auto u, auto v) { return weight.at(u, v) * x.at(u, v); });
      coarse.at(i, j) = sum / std::max(mean, kLeastWeight);
      coarse_weight.at(i, j) = std::min(kTrust * mean, 1.0);
    }
  const Plane below = fill(coarse, coarse_weight, sweeps);
  Plane y(x.h, x.w);
  const auto blend = [&](auto behind) {
    for (std::int64_t i = 0; i < x.h; ++i)
      for (std::int64_t j = 0; j < x.w; ++j)
        y.at(i, j) = weight.at(i, j) * x.at(i, j) + (1 - weight.at(i, j)) * behind(i, j);
  };
  blend([&](auto i, auto j) { return enlarged(below, i, j, x.h, x.w); });
  for (int k = 0; k < sweeps; ++k) {
    const Plane before = y;
    blend([&](auto i, auto j) {
      return (before.near(i - 1, j) + before.near(i + 1, j) + before.near(i, j - 1) + before.near(i, j + 1)) /
             4;
    });
  }
  return y;
}

Plane plane_of(const Tensor& t, const Nchw& shape, std::int64_t index) {
  Plane p(shape.h, shape.w);
  std::copy_n(f64(t) + index * shape.plane(), shape.plane(), p.v.begin());
  return p;
}

}  // namespace

Shape PushPullFillOp::infer(std::span<const Shape> inputs) const {
  require_input_count("push_pull_fill", inputs, 2, 2);
  (void)nchw(inputs[0]);
  require(inputs[1] == inputs[0].with(1, 1),
          "the weight is " + inputs[1].text() + " for values of " + inputs[0].text());
  require(sweeps_ >= 0, "the number of sweeps is negative");
  return inputs[0];
}

void PushPullFillOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const Nchw shape = nchw(inputs[0].shape());
  for_ranges(shape.n * shape.c, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t p = begin; p < end; ++p) {
      const Plane y = fill(plane_of(inputs[0], shape, p), plane_of(inputs[1], shape, p / shape.c), sweeps_);
      std::ranges::copy(y.v, f64(output) + p * shape.plane());
    }
  });
}

void PushPullFillOp::error_scale(std::span<const Tensor> inputs, const Tensor& /*output*/,
                                 Tensor& scale) const {
  const Nchw shape = nchw(inputs[0].shape());
  for (std::int64_t p = 0; p < shape.n * shape.c; ++p) {
    double largest = 0;
    for (std::int64_t i = 0; i < shape.plane(); ++i)
      largest = std::max(largest, std::fabs(f64(inputs[0])[p * shape.plane() + i]));
    std::fill_n(f64(scale) + p * shape.plane(), shape.plane(), largest);
  }
}

Value push_pull_fill(Value x, Value weight, int sweeps) {
  return x.graph().add(std::make_shared<PushPullFillOp>(sweeps), {x, weight});
}

}  // namespace slide::ops
