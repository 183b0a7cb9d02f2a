#include "ops/check.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>

#include "ops/case_file.h"
#include "ops/common/expectation_limit.h"
#include "ops/judge.h"
#include "runtime/error.h"
#include "runtime/plan.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kSmallestNormal = 0x1p-126;
constexpr std::uint32_t kUnwritten = 0x7fc5a5a5U;  // a quiet NaN with a payload that no arithmetic makes

/// Memory between two runs of guard words, all of it filled with kUnwritten.
class GuardedMemory {
 public:
  explicit GuardedMemory(std::size_t bytes)
      : bytes_(bytes), storage_(DType::kU8, {static_cast<std::int64_t>(bytes + 2 * kGuard)}) {
    const std::span<std::byte> all = storage_.mutable_raw();
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = pattern(i);
  }
  [[nodiscard]] std::span<std::byte> span() { return storage_.mutable_raw().subspan(kGuard, bytes_); }
  [[nodiscard]] bool intact() const {
    const std::span<const std::byte> all = storage_.raw();
    for (std::size_t i = 0; i < kGuard; ++i)
      if (all[i] != pattern(i) || all[kGuard + bytes_ + i] != pattern(kGuard + bytes_ + i)) return false;
    return true;
  }

 private:
  static constexpr std::size_t kGuard = 256;  // a multiple of the alignment and longer than any vector
  static std::byte pattern(std::size_t i) {
    return std::bit_cast<std::array<std::byte, sizeof kUnwritten>>(kUnwritten)[i % sizeof kUnwritten];
  }
  std::size_t bytes_;
  Tensor storage_;
};

/// |a - b| by the rules of KernelCheck.
double difference(double a, double b) {
  if (a == b || (std::isnan(a) && std::isnan(b))) return 0;
  const double d = std::fabs(a - b);
  return std::isnan(d) ? kInfinity : d;
}

double largest_finite(std::span<const double> values) {
  double largest = 0;
  for (const double v : values)
    if (std::isfinite(v)) largest = std::max(largest, std::fabs(v));
  return largest;
}

double ratio(double error, double unit) { return error == 0 ? 0 : error / unit; }

Tensor rounded(const Tensor& t) {
  Tensor result = t.to(DType::kF32).clone();
  for (float& v : result.mutable_data<float>())
    if (std::fpclassify(v) == FP_SUBNORMAL) v = 0;
  return result;
}

std::vector<Shape> shapes_of(std::span<const Tensor> tensors) {
  std::vector<Shape> shapes;
  for (const Tensor& t : tensors) shapes.push_back(t.shape());
  return shapes;
}

/// What float32 makes of a float64 result that it cannot hold: an infinity.
double in_float_range(double y) {
  const float f = static_cast<float>(y);
  return std::isinf(f) ? static_cast<double>(f) : y;
}

/// What the kernel measures its errors against, if that is not the operator's scale; else empty.
Tensor own_scale(const Kernel& kernel, const KernelTask& task) {
  std::vector<Tensor> wide;
  for (const Tensor& t : task.inputs) wide.push_back(t.to(DType::kF64));
  Tensor scale(DType::kF64, task.scale.shape());
  return kernel.error_scale(*task.op, wide, task.reference, scale) ? scale : Tensor();
}

/// Where a kernel's result may be NaN or infinite although the definition's is not.
class Outside {
 public:
  Outside(const Kernel& kernel, const KernelTask& task) : domain_(kernel.domain()) {
    const Shape& shape = task.reference.shape();
    const std::int64_t images = shape.rank() > 0 ? shape[0] : 1;
    size_ = static_cast<std::size_t>(
        std::max<std::int64_t>(1, shape.count() / std::max<std::int64_t>(1, images)));
    spoiled_.assign(static_cast<std::size_t>(images), false);
    for (const Tensor& t : task.inputs) note(t, images);
  }
  [[nodiscard]] bool has(std::size_t i, double scale) const {
    return all_ || (std::isfinite(scale) && scale > domain_.largest_scale) || spoiled_[i / size_];
  }

 private:
  void note(const Tensor& t, std::int64_t images) {
    const std::span<const float> x = t.data<float>();
    const bool by_image = t.shape().rank() > 1 && t.shape()[0] == images;
    for (std::size_t i = 0; i < x.size(); ++i) {
      if (std::isfinite(x[i])) {
        all_ = all_ || static_cast<double>(std::fabs(x[i])) > domain_.largest_input;
      } else if (domain_.reach == Reach::kImage) {
        const std::size_t n = i / (x.size() / static_cast<std::size_t>(by_image ? images : 1));
        for (std::size_t k = 0; k < spoiled_.size(); ++k) spoiled_[k] = spoiled_[k] || !by_image || k == n;
      }
    }
  }

  Domain domain_;
  std::size_t size_ = 1;
  bool all_ = false;
  std::vector<bool> spoiled_;  // images
};

/// Sums of squares over the finite elements.
struct Squares {
  double error = 0, result = 0, scale = 0;

  void add(double e, double y, double s) {
    if (!std::isfinite(e) || !std::isfinite(y)) return;
    error += e * e;
    result += y * y;
    scale += s * s;
  }
};

/// How much larger the prediction is because terms cancel; 0 where there is none. See kRmsFactor.
double cancelling(const KernelTask& task, const Squares& squares) {
  const double count = static_cast<double>(std::max<std::int64_t>(1, task.reference.count()));
  const double terms = std::max(1.0, task.op->macs(shapes_of(task.inputs), task.reference.shape()) / count);
  const double beyond = std::sqrt(squares.scale / squares.result / terms) / 2;
  return beyond > 8 ? 0 : std::max(1.0, beyond);
}

/// In place of a scale that is NaN or infinite, the largest that is finite; nothing is judged where none is.
void make_finite(std::span<double> scale) {
  if (std::ranges::none_of(scale, [](double s) { return std::isfinite(s); })) return;
  const double largest = largest_finite(scale);
  for (double& s : scale)
    if (!std::isfinite(s)) s = largest;
}

void measure(const Kernel& kernel, const KernelTask& task, KernelCheck& check) {
  const std::span<const float> y = std::as_const(check.output).data<float>();
  const std::span<const double> y64 = task.reference.data<double>();
  Tensor own = own_scale(kernel, task);
  if (!own.empty() && kernel.domain().reach == Reach::kImage) make_finite(own.mutable_data<double>());
  const std::span<const double> scale = (own.empty() ? task.scale : own).data<double>();
  const std::span<const double> terms = task.scale.data<double>();
  const double u = kernel.unit_roundoff();
  const double flushed = std::max(check.factor, 1.0) * kSmallestNormal;
  const Outside outside(kernel, task);
  Squares squares;
  double worst = 0;
  for (std::size_t i = 0; i < y.size(); ++i) {
    if (std::bit_cast<std::uint32_t>(y[i]) == kUnwritten) ++check.unwritten;
    const double should = in_float_range(y64[i]);
    if (!std::isfinite(y[i]) && !std::isnan(should) && outside.has(i, scale[i])) {
      ++check.outside;
      continue;
    }
    const double error = difference(static_cast<double>(y[i]), should);
    worst = std::max(worst, error);
    const double units = ratio(error, check.factor * u * scale[i] + flushed);
    check.of_bound = std::max(check.of_bound, std::isnan(units) ? kInfinity : units);
    squares.add(std::max(0.0, error - flushed), should, terms[i]);  // flushing is no inexact arithmetic
  }
  check.error_reference = ratio(worst, largest_finite(y64));
  if (squares.result > 0) {
    check.rms = std::sqrt(squares.error / squares.result);
    const auto* limit = dynamic_cast<const ExpectationLimit*>(&kernel);
    if (limit == nullptr || limit->expectation_holds(own, task.scale))
      check.expected_rms =
          kernel.expected_error(*task.op, shapes_of(task.inputs)) * cancelling(task, squares);
  }
}

/// Runs the kernel once and returns its output; notes damaged guards.
Tensor run_guarded(const Kernel& kernel, const KernelTask& task, KernelCheck& check) {
  const std::vector<Shape> shapes = shapes_of(task.inputs);
  const Shape& shape = task.reference.shape();
  GuardedMemory memory(static_cast<std::size_t>(shape.count()) * sizeof(float));
  GuardedMemory packed(kernel.packed_bytes(*task.op, shapes, shape));
  GuardedMemory scratch(kernel.scratch_bytes(*task.op, shapes, shape));
  Tensor output = Tensor::view(DType::kF32, shape, memory.span().data());
  {
    const FlushDenormals flush;
    kernel.pack(*task.op, task.inputs, shapes, packed.span());
    kernel.run(*task.op, task.inputs, output, {shapes, packed.span(), scratch.span(), std::nullopt});
  }
  check.guards_intact = check.guards_intact && memory.intact() && packed.intact() && scratch.intact();
  return output.clone();
}

class ThreadCount {
 public:
  explicit ThreadCount(int count) : saved_(thread_count()) { set_thread_count(count); }
  ~ThreadCount() { set_thread_count(saved_); }
  ThreadCount(const ThreadCount&) = delete;
  ThreadCount& operator=(const ThreadCount&) = delete;

 private:
  int saved_;
};

bool same_bytes(const Tensor& a, const Tensor& b) {
  return std::memcmp(a.raw().data(), b.raw().data(), a.bytes()) == 0;
}

Value build(const OperatorCase& c, Graph& graph) {
  std::vector<std::pair<std::string, Value>> inputs;
  for (const auto& [name, tensor] : c.inputs) inputs.emplace_back(name, graph.input(name, tensor.shape()));
  return build_case(c.op, c.attributes, inputs);
}

/// The kernels of a level up to `isa`, lowest level first as written in the operator's list.
std::vector<const Kernel*> kernels_for(const KernelTask& task, Isa isa) {
  const std::vector<Shape> shapes = shapes_of(task.inputs);
  std::vector<const Kernel*> kernels;
  for (const Kernel* kernel : task.op->kernels())
    if (runs_at(kernel->isa(), isa) && kernel->supports(*task.op, shapes, task.reference.shape()))
      kernels.push_back(kernel);
  std::stable_sort(kernels.begin(), kernels.end(),
                   [](const Kernel* a, const Kernel* b) { return a->isa() < b->isa(); });
  return kernels;
}

/// The largest quotient of |y64 - expected| and what both may lose.
double of_tolerance(const Tensor& y64, const OperatorCase& c, double factor) {
  if (y64.shape() != c.expected.shape()) return kInfinity;
  const CaseValues values = values_of(c, false);
  const Tensor expected = c.expected.to(DType::kF64);
  const double ours = factor * 0x1p-53;
  const double own = c.expected.dtype() == DType::kF64 ? ours : float_factor(values) * 0x1p-24;
  double worst = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(y64.count()); ++i) {
    const double error = difference(y64.data<double>()[i], expected.data<double>()[i]);
    const double bound = ours * values.scale.data<double>()[i] + own * values.textbook.data<double>()[i];
    const double units = ratio(error, bound + kSmallestNormal);
    worst = std::max(worst, std::isnan(units) ? kInfinity : units);
  }
  return worst;
}

}  // namespace

double relative_error(const Tensor& a, const Tensor& b) {
  if (a.shape() != b.shape()) return kInfinity;
  const Tensor a64 = a.to(DType::kF64);
  const Tensor b64 = b.to(DType::kF64);
  const std::span<const double> x = a64.data<double>();
  const std::span<const double> y = b64.data<double>();
  double worst = 0;
  for (std::size_t i = 0; i < x.size(); ++i) worst = std::max(worst, difference(x[i], y[i]));
  return ratio(worst, largest_finite(y));
}

KernelTask make_task(const Op& op, std::span<const Tensor> inputs) {
  KernelTask task;
  task.op = &op;
  std::vector<Tensor> wide;
  for (const Tensor& t : inputs) {
    task.inputs.push_back(rounded(t));
    wide.push_back(task.inputs.back().to(DType::kF64));
  }
  const Shape shape = op.infer(shapes_of(inputs));
  task.reference = Tensor(DType::kF64, shape);
  task.scale = Tensor(DType::kF64, shape);
  op.reference(wide, task.reference);
  op.error_scale(wide, task.reference, task.scale);
  return task;
}

KernelCheck check_kernel(const Kernel& kernel, const KernelTask& task, bool thread_counts) {
  KernelCheck check;
  check.kernel = kernel.name_and_level();
  check.isa = kernel.isa();
  check.factor = kernel.error_factor(*task.op, shapes_of(task.inputs));
  try {
    check.output = run_guarded(kernel, task, check);
    measure(kernel, task, check);
    if (thread_counts) {
      const ThreadCount other(thread_count() == 1 ? 3 : 1);
      check.same_at_any_thread_count = same_bytes(check.output, run_guarded(kernel, task, check));
    }
  } catch (const std::exception& e) {
    check.problem = e.what();
  }
  return check;
}

std::string KernelCheck::verdict() const {
  if (!problem.empty()) return problem;
  if (!guards_intact) return "wrote beside its memory";
  if (unwritten != 0) return "left " + std::to_string(unwritten) + " elements unwritten";
  if (!same_at_any_thread_count) return "depends on the number of threads";
  if (!(of_bound <= 1)) return "over its bound";
  if (unexpected()) return "within its bound, but less exact than its arithmetic";
  return "";
}

bool CaseCheck::passed() const noexcept {
  return reference_passed() && !kernels.empty() &&
         std::all_of(kernels.begin(), kernels.end(), [](const KernelCheck& k) { return k.passed(); });
}

CaseCheck check_case(const OperatorCase& c, Isa isa) {
  Graph graph;
  const int result = build(c, graph).node();
  std::map<int, Tensor> values;
  for (int i = 0; i < static_cast<int>(graph.nodes().size()); ++i) {
    const Node& node = graph.node(i);
    if (node.kind == NodeKind::kConstant) values[i] = node.constant;
    if (node.kind == NodeKind::kInput)
      for (const auto& [name, tensor] : c.inputs)
        if (name == node.name) values[i] = tensor.to(DType::kF64);
  }
  CaseCheck check{c.op, c.attributes, c.source, c.expected.shape(), 0, 0, {}};
  double factor = 0;
  for (int i = 0; i < static_cast<int>(graph.nodes().size()); ++i) {
    const Node& node = graph.node(i);
    if (node.kind != NodeKind::kOp) continue;
    std::vector<Tensor> arguments;
    for (const int j : node.inputs) arguments.push_back(values.at(j));
    values[i] = Tensor(DType::kF64, node.shape);
    node.op->reference(arguments, values[i]);
    factor = std::max(factor, node.op->definition_factor(shapes_of(arguments), node.shape));
    const KernelTask task = make_task(*node.op, arguments);
    for (const Kernel* kernel : kernels_for(task, isa)) {
      check.kernels.push_back(check_kernel(*kernel, task, true));
      KernelCheck& last = check.kernels.back();
      if (i == result && !last.output.empty()) last.error_expected = relative_error(last.output, c.expected);
    }
  }
  check.reference_error = relative_error(values.at(result), c.expected);
  check.of_tolerance = of_tolerance(values.at(result), c, factor);
  return check;
}

}  // namespace slide::ops
