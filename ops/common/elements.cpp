#include "ops/common/elements.h"

#include <algorithm>
#include <cstdio>

#include "runtime/threads.h"

namespace slide::ops {

void require(bool ok, const std::string& problem) {
  if (!ok) throw shape_error(problem);
}

Nchw nchw(const Shape& shape) {
  require_rank("input", shape, 4);
  require(shape.count() > 0, "the input of shape " + shape.text() + " has no elements");
  return {shape[0], shape[1], shape[2], shape[3]};
}

AxisView axis_view(const Shape& shape, int axis) {
  AxisView view{1, shape[axis], 1};
  for (int i = 0; i < axis; ++i) view.outer *= shape[i];
  for (int i = axis + 1; i < shape.rank(); ++i) view.inner *= shape[i];
  return view;
}

void for_ranges(std::int64_t n, std::int64_t grain,
                const std::function<void(std::int64_t, std::int64_t)>& body) {
  parallel_for((n + grain - 1) / grain,
               [&](std::int64_t i) { body(i * grain, std::min(n, (i + 1) * grain)); });
}

double rounding_factor(double n) { return n / (1 - n * 0x1p-24); }

std::string number_text(double value) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%g", value);
  return buffer;
}

}  // namespace slide::ops
