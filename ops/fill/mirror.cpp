#include "ops/fill/mirror.h"

#include <algorithm>
#include <cstdlib>
#include <optional>
#include <tuple>
#include <vector>

#include "ops/common/elements.h"
#include "ops/fill/mirror_op.h"

namespace slide::ops {
namespace {

/// For every pixel the nearest known column of its row, the left one of two; -1 where the row has none.
std::vector<std::int64_t> nearest_in_row(const double* weight, const Nchw& shape) {
  std::vector<std::int64_t> columns(static_cast<std::size_t>(shape.plane()), -1);
  for (std::int64_t i = 0; i < shape.h; ++i)
    for (std::int64_t j = 0; j < shape.w; ++j) {
      std::int64_t& column = columns[static_cast<std::size_t>(i * shape.w + j)];
      for (std::int64_t k = 0; k < shape.w && column < 0; ++k) {
        if (j + k < shape.w && weight[i * shape.w + j + k] >= kKnown) column = j + k;
        if (j - k >= 0 && weight[i * shape.w + j - k] >= kKnown) column = j - k;
      }
    }
  return columns;
}

/// Row and column of the known pixel nearest to (i, j).
std::optional<std::pair<std::int64_t, std::int64_t>> nearest(const std::vector<std::int64_t>& columns,
                                                             const Nchw& shape, std::int64_t i,
                                                             std::int64_t j) {
  std::optional<std::tuple<std::int64_t, std::int64_t, std::int64_t>> best;
  for (std::int64_t row = 0; row < shape.h; ++row) {
    const std::int64_t column = columns[static_cast<std::size_t>(row * shape.w + j)];
    if (column < 0) continue;
    const std::int64_t distance = (row - i) * (row - i) + (column - j) * (column - j);
    if (!best || std::tuple(distance, row, column) < *best) best = {distance, row, column};
  }
  if (!best) return std::nullopt;
  return std::pair(std::get<1>(*best), std::get<2>(*best));
}

/// 2·centre - t, reflected at the first and the last pixel centre.
std::int64_t mirrored(std::int64_t centre, std::int64_t t, std::int64_t size) {
  const std::int64_t far = std::abs(2 * centre - t);
  return std::min(far, 2 * (size - 1) - far);
}

}  // namespace

Shape MirrorKnownOp::infer(std::span<const Shape> inputs) const {
  require_input_count("mirror_known", inputs, 2, 2);
  (void)nchw(inputs[0]);
  require(inputs[1] == inputs[0].with(1, 1),
          "the weight is " + inputs[1].text() + " for values of " + inputs[0].text());
  return inputs[0];
}

void MirrorKnownOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const Nchw shape = nchw(inputs[0].shape());
  for (std::int64_t n = 0; n < shape.n; ++n) {
    const std::vector<std::int64_t> columns = nearest_in_row(f64(inputs[1]) + n * shape.plane(), shape);
    for_ranges(shape.h, 4, [&](std::int64_t begin, std::int64_t end) {
      for (std::int64_t i = begin; i < end; ++i)
        for (std::int64_t j = 0; j < shape.w; ++j) {
          const auto q = nearest(columns, shape, i, j);
          const std::int64_t row = q ? mirrored(q->first, i, shape.h) : i;
          const std::int64_t column = q ? mirrored(q->second, j, shape.w) : j;
          for (std::int64_t c = n * shape.c; c < (n + 1) * shape.c; ++c)
            f64(output)[(c * shape.h + i) * shape.w + j] =
                f64(inputs[0])[(c * shape.h + row) * shape.w + column];
        }
    });
  }
}

Value mirror_known(Value x, Value weight) {
  return x.graph().add(std::make_shared<MirrorKnownOp>(), {x, weight});
}

}  // namespace slide::ops
