#include "runtime/plan.h"

#include <algorithm>

#include "runtime/arena.h"
#include "runtime/error.h"
#include "runtime/lifetime.h"

namespace slide {
namespace {

std::size_t float_bytes(const Shape& shape) {
  return static_cast<std::size_t>(shape.count()) * sizeof(float);
}

std::size_t aligned(std::size_t bytes) {
  return (bytes + Tensor::kAlignment - 1) / Tensor::kAlignment * Tensor::kAlignment;
}

const Kernel& choose_kernel(const Node& node, std::span<const Shape> inputs, Isa isa, Precision precision) {
  const Kernel* best = nullptr;
  const auto better = [&](const Kernel& kernel) {
    if (best == nullptr) return true;
    if (kernel.precision() != best->precision()) return kernel.precision() == precision;
    return kernel.isa() > best->isa();
  };
  for (const Kernel* kernel : node.op->kernels()) {
    const bool allowed = kernel->precision() == precision || kernel->precision() == Precision::kFp32;
    if (allowed && runs_at(kernel->isa(), isa) && kernel->supports(*node.op, inputs, node.shape) &&
        better(*kernel))
      best = kernel;
  }
  if (best == nullptr)
    throw Error(ErrorKind::kInternal, "layer " + node.name + ": no kernel of " +
                                          std::string(node.op->type()) + " for the level " +
                                          std::string(name_of(isa)));
  return *best;
}

/// Nodes that depend on weights and constants only.
void find_constants(const Graph& graph, Plan& plan) {
  const std::size_t total = graph.nodes().size();
  plan.constant.assign(total, false);
  for (std::size_t i = 0; i < total; ++i) {
    const Node& node = graph.nodes()[i];
    plan.constant[i] = node.kind == NodeKind::kParameter || node.kind == NodeKind::kConstant ||
                       (node.kind == NodeKind::kOp && !node.inputs.empty() &&
                        std::all_of(node.inputs.begin(), node.inputs.end(),
                                    [&](int j) { return plan.constant[static_cast<std::size_t>(j)]; }));
  }
}

/// Whether all that the kernel packs is constant.
bool packs_constants(const Plan& plan, const Node& node, const Kernel& kernel) {
  for (std::size_t k = 0; k < node.inputs.size(); ++k)
    if (kernel.packs(k) && !plan.constant[static_cast<std::size_t>(node.inputs[k])]) return false;
  return true;
}

PlanStep plan_step(const Graph& graph, const Plan& plan, int i, Precision precision) {
  const Node& node = graph.node(i);
  const std::vector<Shape> inputs = input_shapes(graph, node);
  const Kernel& kernel = choose_kernel(node, inputs, plan.isa, precision);
  const std::size_t packed = aligned(kernel.packed_bytes(*node.op, inputs, node.shape));
  const bool once = packs_constants(plan, node, kernel);
  const std::size_t scratch = kernel.scratch_bytes(*node.op, inputs, node.shape);
  return {i, &kernel, 0, 0, once ? scratch : packed + scratch, packed, once};
}

/// What a step reads at each run.
void mark_needed(const Graph& graph, const PlanStep& step, Plan& plan) {
  const Node& node = graph.node(step.node);
  for (std::size_t k = 0; k < node.inputs.size(); ++k)
    if (!step.packed_once || !step.kernel->packs(k))
      plan.needed[static_cast<std::size_t>(node.inputs[k])] = true;
}

std::size_t weight_bytes(const Graph& graph, const Plan& plan) {
  std::size_t bytes = 0;
  for (const PlanStep& step : plan.steps)
    if (step.packed_once) bytes += step.packed_bytes;
  for (std::size_t i = 0; i < plan.needed.size(); ++i)
    if (plan.constant[i] && plan.needed[i]) bytes += float_bytes(graph.nodes()[i].shape);
  return bytes;
}

}  // namespace

bool runs_at(Isa kernel, Isa isa) noexcept {
  if (kernel == Isa::kBaseline) return true;
  if (kernel == Isa::kNeon || isa == Isa::kNeon) return kernel == isa;
  return kernel <= isa;
}

Plan make_plan(const Graph& graph, Isa isa, bool keep_all, Precision precision) {
  Plan plan;
  plan.isa = isa;
  find_constants(graph, plan);
  const std::vector<int> last = last_uses(graph);
  const int total = static_cast<int>(graph.nodes().size());
  plan.needed.assign(static_cast<std::size_t>(total), false);
  for (const auto& output : graph.outputs()) plan.needed[static_cast<std::size_t>(output.second)] = true;
  std::vector<ArenaBlock> blocks;  // result and scratch of each step, alternating
  for (int i = 0; i < total; ++i) {
    const std::size_t index = static_cast<std::size_t>(i);
    if (plan.constant[index] || graph.node(i).kind != NodeKind::kOp) continue;
    plan.steps.push_back(plan_step(graph, plan, i, precision));
    mark_needed(graph, plan.steps.back(), plan);
    blocks.push_back({float_bytes(graph.node(i).shape), i, keep_all ? total : last[index]});
    blocks.push_back({plan.steps.back().scratch_bytes, i, i});
  }
  plan.weight_bytes = weight_bytes(graph, plan);
  const ArenaLayout layout = place(blocks);
  plan.arena_bytes = layout.bytes;
  plan.arena_lower_bound = lower_bound(blocks);
  for (std::size_t s = 0; s < plan.steps.size(); ++s) {
    plan.steps[s].offset = layout.offsets[2 * s];
    plan.steps[s].scratch_offset = layout.offsets[2 * s + 1];
  }
  return plan;
}

}  // namespace slide
