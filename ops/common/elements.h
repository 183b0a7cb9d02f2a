#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "ops/common/op_support.h"
#include "runtime/shape.h"
#include "runtime/tensor.h"

namespace slide::ops {

/// Throws shape_error(problem) unless `ok`.
void require(bool ok, const std::string& problem);

/// Batch, channels, height and width.
struct Nchw {
  std::int64_t n, c, h, w;
  [[nodiscard]] std::int64_t plane() const noexcept { return h * w; }
};
/// The extents of a rank-4 shape. Throws Error(kInternal) for another rank or if there are no elements.
[[nodiscard]] Nchw nchw(const Shape& shape);

/// A tensor as outer × axis × inner elements, for operators that work along one axis.
struct AxisView {
  std::int64_t outer, axis, inner;
};
[[nodiscard]] AxisView axis_view(const Shape& shape, int axis);

/// Calls body(begin, end) on consecutive ranges of at most `grain` that cover [0, n), in parallel.
void for_ranges(std::int64_t n, std::int64_t grain,
                const std::function<void(std::int64_t begin, std::int64_t end)>& body);
/// Elements per range for cheap element-wise work.
inline constexpr std::int64_t kElementGrain = 1 << 15;

[[nodiscard]] inline const double* f64(const Tensor& t) { return t.data<double>().data(); }
[[nodiscard]] inline double* f64(Tensor& t) { return t.mutable_data<double>().data(); }
[[nodiscard]] inline const float* f32(const Tensor& t) { return t.data<float>().data(); }
[[nodiscard]] inline float* f32(Tensor& t) { return t.mutable_data<float>().data(); }

/// The factor n / (1 - n·u) of n successive roundings in float32 (gamma_n / u in Higham, "Accuracy and
/// Stability of Numerical Algorithms", lemma 3.1).
[[nodiscard]] double rounding_factor(double n);

/// An attribute as text, short enough to read: "0.2".
[[nodiscard]] std::string number_text(double value);

}  // namespace slide::ops
