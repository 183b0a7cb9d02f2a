// These operators move elements and compute nothing, so one function serves both element types: the float64
// reference, and a float32 kernel that is the same at every instruction-set level and exact.

#include "ops/tensor_shape/tensor_shape.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "ops/common/elements.h"
#include "ops/tensor_shape/tensor_shape_ops.h"

namespace slide::ops {
namespace {

/// `count` runs of numbers, each from_step and to_step behind the one before. What is in its place already
/// (SharesStorage) stays.
template <typename T>
void copy_runs(const T* from, std::int64_t from_step, T* to, std::int64_t to_step, std::int64_t run,
               std::int64_t count) {
  if (from == to || run == 0) return;
  const std::int64_t pieces = (run + kElementGrain - 1) / kElementGrain;
  for_ranges(count * pieces, std::max<std::int64_t>(1, kElementGrain / run),
             [&](std::int64_t begin, std::int64_t end) {
               for (std::int64_t i = begin; i < end; ++i) {
                 const std::int64_t first = i % pieces * kElementGrain;
                 const std::int64_t length = std::min(kElementGrain, run - first);
                 std::memcpy(to + i / pieces * to_step + first, from + i / pieces * from_step + first,
                             static_cast<std::size_t>(length) * sizeof(T));
               }
             });
}

template <typename T>
void compute(const ConcatOp& op, std::span<const Tensor> inputs, Tensor& output) {
  const AxisView out = axis_view(output.shape(), op.axis());
  T* y = output.mutable_data<T>().data();
  std::int64_t offset = 0;
  for (const Tensor& input : inputs) {
    const T* x = input.data<T>().data();
    const std::int64_t run = input.shape()[op.axis()] * out.inner;
    copy_runs(x, run, y + offset, out.axis * out.inner, run, out.outer);
    offset += run;
  }
}

template <typename T>
void compute(const SliceOp& op, std::span<const Tensor> inputs, Tensor& output) {
  const int rank = output.shape().rank();
  const AxisView in = axis_view(inputs[0].shape(), op.axis() < 0 ? op.axis() + rank : op.axis());
  const T* x = inputs[0].data<T>().data();
  T* y = output.mutable_data<T>().data();
  const std::int64_t run = (op.end() - op.start()) * in.inner;
  copy_runs(x + op.start() * in.inner, in.axis * in.inner, y, run, run, in.outer);
}

/// Where output index i of a padded axis comes from; -1 for the constant.
std::int64_t pad_source(std::int64_t i, std::int64_t before, std::int64_t extent, PadMode mode) {
  const std::int64_t s = i - before;
  if (s >= 0 && s < extent) return s;
  switch (mode) {
    case PadMode::kConstant:
      return -1;
    case PadMode::kEdge:
      return s < 0 ? 0 : extent - 1;
    case PadMode::kReflect:
      return s < 0 ? -s : 2 * (extent - 1) - s;
  }
  return -1;
}

template <typename T>
void compute(const PadOp& op, std::span<const Tensor> inputs, Tensor& output) {
  const Nchw in = nchw(inputs[0].shape());
  const Nchw out = nchw(output.shape());
  const std::int64_t top = op.padding()[0];
  const std::int64_t left = op.padding()[1];
  const T* x = inputs[0].data<T>().data();
  T* y = output.mutable_data<T>().data();
  const T value = static_cast<T>(op.value());
  const auto pad_row = [&](const T* from, T* to) {
    for (std::int64_t j = 0; j < left; ++j) {
      const std::int64_t source = pad_source(j, left, in.w, op.mode());
      to[j] = source < 0 ? value : from[source];
    }
    std::copy_n(from, in.w, to + left);
    for (std::int64_t j = left + in.w; j < out.w; ++j) {
      const std::int64_t source = pad_source(j, left, in.w, op.mode());
      to[j] = source < 0 ? value : from[source];
    }
  };
  for_ranges(in.n * in.c, 1, [&](std::int64_t plane, std::int64_t) {
    for (std::int64_t i = 0; i < out.h; ++i) {
      T* row = y + (plane * out.h + i) * out.w;
      const std::int64_t source = pad_source(i, top, in.h, op.mode());
      if (source < 0)
        std::fill(row, row + out.w, value);
      else
        pad_row(x + (plane * in.h + source) * in.w, row);
    }
  });
}

template <typename T>
void compute(const ReshapeOp& /*op*/, std::span<const Tensor> inputs, Tensor& output) {
  copy_runs(inputs[0].data<T>().data(), 0, output.mutable_data<T>().data(), 0, output.count(), 1);
}

/// Rows of the result's last axis: each is a run of x with one step.
/// Where the elements of a plane of `out`, its last two axes, begin in a tensor of those steps.
std::int64_t plane_start(const Shape& out, const std::vector<std::int64_t>& steps, std::int64_t plane) {
  std::int64_t at = 0;
  for (int k = out.rank() - 3; k >= 0; --k) {
    at += plane % out[k] * steps[static_cast<std::size_t>(k)];
    plane /= out[k];
  }
  return at;
}

template <typename T>
void compute(const PermuteOp& op, std::span<const Tensor> inputs, Tensor& output) {
  const Shape& in = inputs[0].shape();
  const Shape& out = output.shape();
  const auto rank = static_cast<std::size_t>(out.rank());
  std::vector<std::int64_t> steps(rank);  // in x, for each axis of the result
  for (std::size_t k = 0; k < rank; ++k) {
    steps[k] = 1;
    for (int axis = op.axes()[k] + 1; axis < in.rank(); ++axis) steps[k] *= in[axis];
  }
  const T* x = inputs[0].data<T>().data();
  T* y = output.mutable_data<T>().data();
  const std::int64_t width = out[-1];
  if (out.count() == 0) return;
  const std::int64_t rows = rank > 1 ? out[-2] : 1;
  const std::int64_t step = steps[rank - 1];
  const std::int64_t row_step = rank > 1 ? steps[rank - 2] : 0;
  // Rows may be of two or four elements: where one begins is found out once for all those of a plane.
  for_ranges(out.count() / width, std::max<std::int64_t>(1, kElementGrain / width),
             [&](std::int64_t begin, std::int64_t end) {
               for (std::int64_t row = begin; row < end;) {
                 const std::int64_t first = row % rows;
                 const std::int64_t count = std::min(rows - first, end - row);
                 const T* from = x + plane_start(out, steps, row / rows) + first * row_step;
                 T* to = y + row * width;
                 for (std::int64_t i = 0; i < count; ++i)
                   for (std::int64_t j = 0; j < width; ++j) to[i * width + j] = from[i * row_step + j * step];
                 row += count;
               }
             });
}

template <typename O>
class CopyKernel : public Kernel {
 public:
  explicit CopyKernel(std::string_view name) : name_(name) {}
  [[nodiscard]] std::string_view name() const override { return name_; }
  [[nodiscard]] Isa isa() const override { return Isa::kBaseline; }
  [[nodiscard]] bool supports(const Op&, std::span<const Shape>, const Shape&) const override { return true; }
  /// 1 for the rounding of a padding constant; copies are exact.
  [[nodiscard]] double error_factor(const Op& op, std::span<const Shape>) const override {
    return op.type() == "pad" ? 1 : 0;
  }
  void run(const Op& op, std::span<const Tensor> inputs, Tensor& output,
           const KernelCall& /*call*/) const override {
    compute<float>(static_cast<const O&>(op), inputs, output);
  }

 private:
  std::string_view name_;
};

template <typename O>
std::span<const Kernel* const> copy_kernels(std::string_view name) {
  static const CopyKernel<O> kernel(name);
  static const Kernel* const list[] = {&kernel};
  return list;
}

}  // namespace

Shape ConcatOp::infer(std::span<const Shape> inputs) const {
  require(!inputs.empty(), "concat was given no tensor");
  std::int64_t extent = 0;
  for (const Shape& shape : inputs) {
    require(
        axis_ < shape.rank() && shape.rank() == inputs[0].rank() &&
            shape.with(axis_, 1) == inputs[0].with(axis_, 1),
        "cannot join " + inputs[0].text() + " and " + shape.text() + " along axis " + std::to_string(axis_));
    require(!__builtin_add_overflow(extent, shape[axis_], &extent), "concat is too large");
  }
  return inputs[0].with(axis_, extent);
}
std::optional<std::int64_t> ConcatOp::storage_offset(std::size_t index, std::span<const Shape> inputs) const {
  if (axis_view(inputs[0], axis_).outer != 1) return std::nullopt;
  std::int64_t offset = 0;
  for (std::size_t k = 0; k < index; ++k) offset += inputs[k].count();
  return offset;
}
void ConcatOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  compute<double>(*this, inputs, output);
}
/// Channels one after the other.
NodeStatistics ConcatOp::statistics(const StatisticsCall& call) const {
  const auto varying = [](const ValueStatistics& s) { return s.channels() > 0; };
  if (axis_ != 1 || !std::ranges::all_of(call.inputs, varying)) return handed_on(*this, call);
  NodeStatistics result;
  ValueStatistics& all = result.output;
  for (const ValueStatistics& s : call.inputs) {
    all.mean.insert(all.mean.end(), s.mean.begin(), s.mean.end());
    all.variance.insert(all.variance.end(), s.variance.begin(), s.variance.end());
  }
  return result;
}

std::span<const Kernel* const> ConcatOp::kernels() const { return copy_kernels<ConcatOp>("concat.copy"); }

std::string SliceOp::attributes() const {
  return "axis " + std::to_string(axis_) + " from " + std::to_string(start_) + " to " + std::to_string(end_);
}
Shape SliceOp::infer(std::span<const Shape> inputs) const {
  require_input_count("slice", inputs, 1, 1);
  const int axis = require_axis("slice", axis_, inputs[0]);
  require(0 <= start_ && start_ < end_ && end_ <= inputs[0][axis],
          "cannot take elements " + std::to_string(start_) + " to " + std::to_string(end_) + " of axis " +
              std::to_string(axis) + " of " + inputs[0].text());
  return inputs[0].with(axis, end_ - start_);
}
std::optional<std::int64_t> SliceOp::storage_offset(std::size_t /*index*/,
                                                    std::span<const Shape> inputs) const {
  const AxisView in = axis_view(inputs[0], axis_ < 0 ? axis_ + inputs[0].rank() : axis_);
  if (in.outer != 1) return std::nullopt;
  return -start_ * in.inner;
}
void SliceOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  compute<double>(*this, inputs, output);
}
std::span<const Kernel* const> SliceOp::kernels() const { return copy_kernels<SliceOp>("slice.copy"); }

std::string PadOp::attributes() const {
  constexpr std::array<std::string_view, 3> kModes = {"constant", "edge", "reflect"};
  std::string text(kModes[static_cast<std::size_t>(mode_)]);
  if (mode_ == PadMode::kConstant) text += " " + number_text(value_);
  for (const std::int64_t p : padding_) text += " " + std::to_string(p);
  return text;
}
Shape PadOp::infer(std::span<const Shape> inputs) const {
  require_input_count("pad", inputs, 1, 1);
  const Nchw in = nchw(inputs[0]);
  for (const std::int64_t p : padding_) {
    require_at_least("padding", p, 0);
    require(p <= std::int64_t{1} << 40, "the padding " + std::to_string(p) + " is too large");
  }
  const auto [top, left, bottom, right] = padding_;
  if (mode_ == PadMode::kReflect)
    require(std::max(top, bottom) < in.h && std::max(left, right) < in.w,
            "reflecting needs a padding less than the extent: " + attributes() + " of " + inputs[0].text());
  return {in.n, in.c, in.h + top + bottom, in.w + left + right};
}
void PadOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  compute<double>(*this, inputs, output);
}
std::span<const Kernel* const> PadOp::kernels() const { return copy_kernels<PadOp>("pad.copy"); }

Shape ReshapeOp::infer(std::span<const Shape> inputs) const {
  require_input_count("reshape", inputs, 1, 1);
  require(inputs[0].count() == shape_.count(), "cannot reshape " + inputs[0].text() + " to " + shape_.text());
  return shape_;
}
std::optional<std::int64_t> ReshapeOp::storage_offset(std::size_t /*index*/,
                                                      std::span<const Shape> /*inputs*/) const {
  return 0;
}
void ReshapeOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  compute<double>(*this, inputs, output);
}
std::span<const Kernel* const> ReshapeOp::kernels() const { return copy_kernels<ReshapeOp>("reshape.copy"); }

std::string PermuteOp::attributes() const {
  std::string text = "axes";
  for (const int axis : axes_) text += " " + std::to_string(axis);
  return text;
}
Shape PermuteOp::infer(std::span<const Shape> inputs) const {
  require_input_count("permute", inputs, 1, 1);
  const int rank = inputs[0].rank();
  std::vector<int> sorted = axes_;
  std::ranges::sort(sorted);
  bool each_once = rank > 0 && sorted.size() == static_cast<std::size_t>(rank);
  for (int k = 0; each_once && k < rank; ++k) each_once = sorted[static_cast<std::size_t>(k)] == k;
  require(each_once, "permute cannot bring " + inputs[0].text() + " into the order of " + attributes());
  std::vector<std::int64_t> extents;
  for (const int axis : axes_) extents.push_back(inputs[0][axis]);
  return Shape(std::span<const std::int64_t>(extents));
}
void PermuteOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  compute<double>(*this, inputs, output);
}
std::span<const Kernel* const> PermuteOp::kernels() const { return copy_kernels<PermuteOp>("permute.copy"); }

Value concat(const std::vector<Value>& inputs, int axis) {
  require(!inputs.empty(), "concat was given no tensor");
  const int index = require_axis("concat", axis, inputs[0].shape());
  return inputs[0].graph().add(std::make_shared<ConcatOp>(index), inputs);
}

Value slice(Value x, int axis, std::int64_t start, std::int64_t end) {
  return x.graph().add(std::make_shared<SliceOp>(axis, start, end), {x});
}

Value pad(Value x, const std::array<std::int64_t, 4>& padding, PadMode mode, double value) {
  return x.graph().add(std::make_shared<PadOp>(padding, mode, value), {x});
}

Value permute(Value x, const std::vector<int>& axes) {
  return x.graph().add(std::make_shared<PermuteOp>(axes), {x});
}

Value reshape(Value x, const Shape& shape) { return x.graph().add(std::make_shared<ReshapeOp>(shape), {x}); }

}  // namespace slide::ops
