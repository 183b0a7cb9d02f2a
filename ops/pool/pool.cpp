#include "ops/pool/pool.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "ops/pool/pool_op.h"

namespace slide::ops {
namespace {

/// Output size along an axis, as PyTorch computes it: with ceil_mode the last window is dropped if it would
/// start beyond input and leading padding.
std::int64_t pooled_extent(const PoolParams& p, std::size_t axis, std::int64_t extent) {
  const std::int64_t before = p.padding[axis];
  const std::int64_t after = p.padding[axis + 2];
  const std::int64_t stride = p.stride[axis];
  const std::int64_t room = extent + before + after - p.kernel[axis] + (p.ceil_mode ? stride - 1 : 0);
  if (room < 0) return 0;
  const std::int64_t count = room / stride + 1;
  return p.ceil_mode && (count - 1) * stride >= extent + before ? count - 1 : count;
}

/// Calls body(plane, i, j, output index) for every output position, planes in parallel.
template <typename Body>
void for_outputs(const Nchw& out, Body body) {
  for_ranges(out.n * out.c, 1, [&](std::int64_t plane, std::int64_t) {
    for (std::int64_t i = 0; i < out.h; ++i)
      for (std::int64_t j = 0; j < out.w; ++j) body(plane, i, j, (plane * out.h + i) * out.w + j);
  });
}

/// The sum of f(x) over a window of a plane with rows of `width`.
template <typename F>
double window_sum(const double* plane, std::int64_t width, PoolWindow rows, PoolWindow columns, F f) {
  double sum = 0;
  for (std::int64_t i = rows.begin; i < rows.end; ++i)
    for (std::int64_t j = columns.begin; j < columns.end; ++j) sum += f(plane[i * width + j]);
  return sum;
}

double identity(double v) { return v; }

/// Larger of two, NaN if either is.
double larger(double a, double b) { return std::isnan(a) || a > b ? a : b; }

/// Mean of f(x) over each window.
template <typename F>
void average(const PoolOp& op, const Tensor& input, Tensor& output, F f) {
  const Nchw in = nchw(input.shape());
  const double* x = f64(input);
  double* y = f64(output);
  for_outputs(nchw(output.shape()), [&](std::int64_t plane, std::int64_t i, std::int64_t j, std::int64_t at) {
    const double sum =
        window_sum(x + plane * in.plane(), in.w, op.window(0, i, in.h), op.window(1, j, in.w), f);
    y[at] = sum / static_cast<double>(op.divisor(0, i, in.h) * op.divisor(1, j, in.w));
  });
}

template <typename F>
void adaptive_average(const Tensor& input, Tensor& output, F f) {
  const Nchw in = nchw(input.shape());
  const Nchw out = nchw(output.shape());
  const double* x = f64(input);
  double* y = f64(output);
  for_outputs(out, [&](std::int64_t plane, std::int64_t i, std::int64_t j, std::int64_t at) {
    const PoolWindow rows = AdaptiveAvgPoolOp::window(i, out.h, in.h);
    const PoolWindow columns = AdaptiveAvgPoolOp::window(j, out.w, in.w);
    const double sum = window_sum(x + plane * in.plane(), in.w, rows, columns, f);
    y[at] = sum / static_cast<double>((rows.end - rows.begin) * (columns.end - columns.begin));
  });
}

}  // namespace

PoolWindow PoolOp::window(int axis, std::int64_t output_index, std::int64_t extent) const {
  const auto a = static_cast<std::size_t>(axis);
  const std::int64_t start = output_index * params_.stride[a] - params_.padding[a];
  return {std::max<std::int64_t>(start, 0), std::min(start + params_.kernel[a], extent)};
}

std::int64_t PoolOp::divisor(int axis, std::int64_t output_index, std::int64_t extent) const {
  const auto a = static_cast<std::size_t>(axis);
  const PoolWindow inside = window(axis, output_index, extent);
  if (!params_.count_include_pad) return inside.end - inside.begin;
  const std::int64_t start = output_index * params_.stride[a] - params_.padding[a];
  return std::min(start + params_.kernel[a], extent + params_.padding[a + 2]) - start;
}

std::string_view PoolOp::type() const { return kind_ == PoolKind::kMax ? "max_pool2d" : "avg_pool2d"; }

std::string PoolOp::attributes() const {
  const auto pair = [](const auto& p) { return std::to_string(p[0]) + "x" + std::to_string(p[1]); };
  std::string text = pair(params_.kernel) + " stride " + pair(params_.stride) + " padding";
  for (const std::int64_t p : params_.padding) text += " " + std::to_string(p);
  if (params_.ceil_mode) text += " ceil";
  if (params_.count_include_pad) text += " counting padding";
  return text;
}

Shape PoolOp::infer(std::span<const Shape> inputs) const {
  require_input_count(type(), inputs, 1, 1);
  const Nchw in = nchw(inputs[0]);
  constexpr std::int64_t kMost = std::int64_t{1} << 31;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    require_at_least("kernel", params_.kernel[axis], 1);
    require_at_least("stride", params_.stride[axis], 1);
    require(params_.kernel[axis] <= kMost && params_.stride[axis] <= kMost,
            "the window " + attributes() + " is too large");
    for (const std::int64_t p : {params_.padding[axis], params_.padding[axis + 2]})
      require(p >= 0 && p < params_.kernel[axis],
              "the padding must be less than the kernel: " + attributes());
  }
  const std::int64_t h = pooled_extent(params_, 0, in.h);
  const std::int64_t w = pooled_extent(params_, 1, in.w);
  require(h > 0 && w > 0, "the window " + attributes() + " does not fit into " + inputs[0].text());
  return {in.n, in.c, h, w};
}

void PoolOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  if (kind_ == PoolKind::kAverage) {
    average(*this, inputs[0], output, identity);
    return;
  }
  const Nchw in = nchw(inputs[0].shape());
  const double* x = f64(inputs[0]);
  double* y = f64(output);
  for_outputs(nchw(output.shape()), [&](std::int64_t plane, std::int64_t i, std::int64_t j, std::int64_t at) {
    const PoolWindow rows = window(0, i, in.h);
    const PoolWindow columns = window(1, j, in.w);
    double best = -std::numeric_limits<double>::infinity();
    for (std::int64_t r = rows.begin; r < rows.end; ++r)
      for (std::int64_t c = columns.begin; c < columns.end; ++c)
        best = larger(best, x[plane * in.plane() + r * in.w + c]);
    y[at] = best;
  });
}

/// The mean of magnitudes for averages, |y| for maxima.
void PoolOp::error_scale(std::span<const Tensor> inputs, const Tensor& output, Tensor& scale) const {
  if (kind_ == PoolKind::kMax) return Op::error_scale(inputs, output, scale);
  average(*this, inputs[0], scale, [](double v) { return std::fabs(v); });
}

std::string AdaptiveAvgPoolOp::attributes() const {
  return "to " + std::to_string(height_) + "x" + std::to_string(width_);
}

Shape AdaptiveAvgPoolOp::infer(std::span<const Shape> inputs) const {
  require_input_count(type(), inputs, 1, 1);
  const Nchw in = nchw(inputs[0]);
  constexpr std::int64_t kMost = std::int64_t{1} << 31;
  for (const std::int64_t size : {height_, width_})
    require(size >= 1 && size <= kMost,
            "cannot pool to " + std::to_string(height_) + "x" + std::to_string(width_));
  return {in.n, in.c, height_, width_};
}

void AdaptiveAvgPoolOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  adaptive_average(inputs[0], output, identity);
}

void AdaptiveAvgPoolOp::error_scale(std::span<const Tensor> inputs, const Tensor& /*output*/,
                                    Tensor& scale) const {
  adaptive_average(inputs[0], scale, [](double v) { return std::fabs(v); });
}

Value max_pool2d(Value x, const PoolParams& params) {
  return x.graph().add(std::make_shared<PoolOp>(PoolKind::kMax, params), {x});
}
Value avg_pool2d(Value x, const PoolParams& params) {
  return x.graph().add(std::make_shared<PoolOp>(PoolKind::kAverage, params), {x});
}
Value global_avg_pool2d(Value x) { return adaptive_avg_pool2d(x, 1, 1); }
Value adaptive_avg_pool2d(Value x, std::int64_t height, std::int64_t width) {
  return x.graph().add(std::make_shared<AdaptiveAvgPoolOp>(height, width), {x});
}

}  // namespace slide::ops
