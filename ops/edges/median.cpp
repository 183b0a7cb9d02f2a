#include "ops/edges/median.h"

#include <algorithm>
#include <vector>

#include "ops/common/elements.h"
#include "ops/edges/median_op.h"

namespace slide::ops {

Shape MedianOp::infer(std::span<const Shape> inputs) const {
  require_input_count("median", inputs, 1, 1);
  (void)nchw(inputs[0]);
  require(
      radius_ >= 0 && radius_ <= kLargestMedianRadius,
      "the radius is " + std::to_string(radius_) + ", not in 0 to " + std::to_string(kLargestMedianRadius));
  return inputs[0];
}

void MedianOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const Nchw s = nchw(inputs[0].shape());
  const auto less = [](double a, double b) { return a < b || (std::isnan(b) && !std::isnan(a)); };
  for_ranges(s.n * s.c * s.h, 1, [&](std::int64_t row, std::int64_t) {
    const double* plane = f64(inputs[0]) + row / s.h * s.plane();
    std::vector<double> window;
    for (std::int64_t j = 0; j < s.w; ++j) {
      window.clear();
      for (std::int64_t u = -radius_; u <= radius_; ++u)
        for (std::int64_t v = -radius_; v <= radius_; ++v)
          window.push_back(plane[std::clamp<std::int64_t>(row % s.h + u, 0, s.h - 1) * s.w +
                                 std::clamp<std::int64_t>(j + v, 0, s.w - 1)]);
      const auto middle = window.begin() + std::ssize(window) / 2;
      std::nth_element(window.begin(), middle, window.end(), less);
      f64(output)[row * s.w + j] = *middle;
    }
  });
}

Value median(Value x, std::int64_t radius) { return x.graph().add(std::make_shared<MedianOp>(radius), {x}); }

}  // namespace slide::ops
