#include "ops/layering/distance_transform.h"

#include <algorithm>
#include <limits>
#include <vector>

#include "ops/common/elements.h"

namespace slide::ops {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// For every pixel of column j the distance to the nearest pixel of that column with x > 0.5.
void along_column(const double* x, const Nchw& shape, std::int64_t j, double* distance) {
  double nearest = kInfinity;
  for (std::int64_t i = 0; i < shape.h; ++i) {
    nearest = x[i * shape.w + j] > 0.5 ? 0 : nearest + 1;
    distance[i * shape.w + j] = nearest;
  }
  for (std::int64_t i = shape.h - 1; i-- > 0;)
    distance[i * shape.w + j] = std::min(distance[i * shape.w + j], distance[(i + 1) * shape.w + j] + 1);
}

}  // namespace

Shape DistanceTransformOp::infer(std::span<const Shape> inputs) const {
  require_input_count("distance_transform", inputs, 1, 1);
  const Nchw in = nchw(inputs[0]);
  require(std::max(in.h, in.w) <= std::int64_t{1} << 24, "the image " + inputs[0].text() + " is too large");
  return inputs[0];
}

/// The least over all columns k of (j - k)² + g(k)², g(k) the distance along column k from the pixel's row:
/// as of the pixels of one column the nearest one is the nearest along it. Exact: all numbers are integers
/// below 2^53.
void DistanceTransformOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const Nchw in = nchw(inputs[0].shape());
  std::vector<double> column(static_cast<std::size_t>(in.plane()));
  for (std::int64_t p = 0; p < in.n * in.c; ++p) {
    for (std::int64_t j = 0; j < in.w; ++j)
      along_column(f64(inputs[0]) + p * in.plane(), in, j, column.data());
    double* y = f64(output) + p * in.plane();
    for_ranges(in.h, 4, [&](std::int64_t begin, std::int64_t end) {
      for (std::int64_t i = begin; i < end; ++i) {
        const double* g = column.data() + i * in.w;
        for (std::int64_t j = 0; j < in.w; ++j) {
          double least = kInfinity;
          for (std::int64_t k = 0; k < in.w; ++k)
            least = std::min(least, static_cast<double>((j - k) * (j - k)) + g[k] * g[k]);
          y[i * in.w + j] = least;
        }
      }
    });
  }
}

Value distance_transform(Value x) { return x.graph().add(std::make_shared<DistanceTransformOp>(), {x}); }

}  // namespace slide::ops
