// Every step, and every constant that steps read as it is, is a task of its own: it evaluates the constant
// nodes that it needs, and forgets them. Vectors that several tasks need (the factors of a folded batch norm)
// are computed by each, which costs less than to wait for one another.

#include "runtime/constants.h"

#include <algorithm>
#include <functional>
#include <map>

#include "runtime/error.h"
#include "runtime/lifetime.h"
#include "runtime/threads.h"

namespace slide {
namespace {

constexpr std::size_t kReleased = 3 << 14;  // bytes that are worth a call of the system before the end
constexpr std::int64_t kSlab = 1 << 13;     // elements folded at a time: all in the second-level cache

/// The rows begin <= r < end along the first axis.
Tensor rows_of(const Tensor& t, std::int64_t begin, std::int64_t end) {
  const Shape shape = t.shape().with(0, end - begin);
  const std::size_t row = t.bytes() / static_cast<std::size_t>(t.shape()[0]);
  return Tensor::read_only(t.dtype(), shape, t.raw().data() + static_cast<std::size_t>(begin) * row, nullptr);
}

/// The constants of one task.
class Evaluation {
 public:
  Evaluation(const Graph& graph, const WeightSource& weights) : graph_(graph), weights_(weights) {}
  Evaluation(const Evaluation&) = delete;
  Evaluation& operator=(const Evaluation&) = delete;
  ~Evaluation() {
    for (const auto& [i, value] : values_)
      if (graph_.node(i).kind == NodeKind::kParameter && value.bytes() >= kReleased)
        weights_.release(graph_.node(i).name);
  }

  /// A constant in float32; one that has to be folded lies in `memory` if that is large enough.
  Tensor float32(int i, std::span<std::byte> memory) {
    const Node& node = graph_.node(i);
    if (!splits(i)) return value(i).to(DType::kF32);
    const std::size_t bytes = static_cast<std::size_t>(node.shape.count()) * sizeof(float);
    Tensor result = bytes <= memory.size() ? Tensor::view(DType::kF32, node.shape, memory.data())
                                           : Tensor(DType::kF32, node.shape);
    const std::int64_t row = node.shape.count() / node.shape[0];
    const std::int64_t step = std::max<std::int64_t>(1, kSlab / row);
    for (std::int64_t begin = 0; begin < node.shape[0]; begin += step) {
      const std::int64_t end = std::min(begin + step, node.shape[0]);
      const Tensor slab = rows(i, begin, end);
      std::ranges::transform(slab.data<double>(), result.mutable_data<float>().data() + begin * row,
                             [](double x) { return static_cast<float>(x); });
    }
    return result;
  }

 private:
  /// Whether the node's rows can be computed one after the other, and are worth it.
  [[nodiscard]] bool splits(int i) const {
    const Node& node = graph_.node(i);
    return node.kind == NodeKind::kOp && node.op->by_rows() && node.shape.rank() > 0 &&
           node.shape.count() > kSlab;
  }

  /// A whole constant: a weight as stored, else F64.
  const Tensor& value(int i) {
    if (const auto found = values_.find(i); found != values_.end()) return found->second;
    const Node& node = graph_.node(i);
    if (node.kind == NodeKind::kParameter) return values_[i] = parameter(node, weights_);
    if (node.kind == NodeKind::kConstant) return values_[i] = node.constant;
    std::vector<Tensor> arguments;
    for (const int j : node.inputs) arguments.push_back(value(j).to(DType::kF64));
    return values_[i] = result(node, arguments, node.shape);
  }

  /// Some rows of a constant, F64.
  Tensor rows(int i, std::int64_t begin, std::int64_t end) {
    if (!splits(i)) return rows_of(value(i), begin, end).to(DType::kF64);
    const Node& node = graph_.node(i);
    std::vector<Tensor> arguments;
    for (const int j : node.inputs) {
      const Shape& shape = graph_.node(j).shape;
      const bool has_rows = shape.rank() == node.shape.rank() && shape[0] == node.shape[0];
      arguments.push_back(has_rows ? rows(j, begin, end) : value(j).to(DType::kF64));
    }
    return result(node, arguments, node.shape.with(0, end - begin));
  }

  static Tensor result(const Node& node, std::span<const Tensor> arguments, const Shape& shape) {
    Tensor computed(DType::kF64, shape);
    node.op->reference(arguments, computed);
    return computed;
  }

  const Graph& graph_;
  const WeightSource& weights_;
  std::map<int, Tensor> values_;
};

void pack(const Graph& graph, const PlanStep& step, const WeightSource& weights, std::span<std::byte> memory,
          std::span<std::byte> packed) {
  const Node& node = graph.node(step.node);
  Evaluation constants(graph, weights);
  std::vector<Tensor> inputs(node.inputs.size());
  for (std::size_t k = 0; k < inputs.size(); ++k) {
    if (!step.kernel->packs(k)) continue;
    inputs[k] = constants.float32(node.inputs[k], memory);
    if (inputs[k].raw().data() == memory.data())
      memory = memory.subspan(std::min(memory.size(), Tensor::aligned(inputs[k].bytes())));
  }
  step.kernel->pack(*node.op, inputs, input_shapes(graph, node), packed);
}

/// By step; all in one block.
std::vector<std::span<std::byte>> place_packed(const Plan& plan, Tensor& memory) {
  std::size_t total = 0;
  for (const PlanStep& step : plan.steps)
    if (step.packed_once) total += step.packed_bytes;
  memory = Tensor(DType::kU8, {static_cast<std::int64_t>(total)});
  std::span<std::byte> rest = memory.mutable_raw();
  std::vector<std::span<std::byte>> packed;
  for (const PlanStep& step : plan.steps) {
    packed.push_back(rest.first(step.packed_once ? step.packed_bytes : 0));
    rest = rest.subspan(packed.back().size());
  }
  return packed;
}

}  // namespace

Tensor constant_value(const Graph& graph, const WeightSource& weights, int node) {
  return Evaluation(graph, weights).float32(node, {}).to(DType::kF64);
}

PlanConstants load_constants(const Graph& graph, const Plan& plan, const WeightSource& weights,
                             std::span<std::byte> scratch) {
  require_fit(graph, weights);
  PlanConstants constants;
  constants.values.resize(graph.nodes().size());
  const std::vector<std::span<std::byte>> packed = place_packed(plan, constants.memory);
  constants.packed.assign(packed.begin(), packed.end());
  const std::size_t share =
      scratch.size() / static_cast<std::size_t>(thread_count()) / Tensor::kAlignment * Tensor::kAlignment;
  std::vector<std::function<void()>> tasks;
  for (std::size_t s = 0; s < packed.size(); ++s)
    if (!packed[s].empty())
      tasks.emplace_back([&, s] {
        const std::size_t first = static_cast<std::size_t>(thread_index()) * share;
        pack(graph, plan.steps[s], weights, scratch.subspan(first, share), packed[s]);
      });
  for (std::size_t i = 0; i < constants.values.size(); ++i)
    if (plan.constant[i] && plan.needed[i])
      tasks.emplace_back([&, i] {
        const Tensor value = Evaluation(graph, weights).float32(static_cast<int>(i), {});
        constants.values[i] = graph.nodes()[i].kind == NodeKind::kOp ? value : value.clone();
      });
  parallel_for(static_cast<std::int64_t>(tasks.size()),
               [&](std::int64_t t) { tasks[static_cast<std::size_t>(t)](); });
  weights.release();
  return constants;
}

}  // namespace slide
