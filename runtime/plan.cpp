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

std::vector<Shape> input_shapes(const Graph& graph, const Node& node) {
  std::vector<Shape> shapes;
  shapes.reserve(node.inputs.size());
  for (const int j : node.inputs) shapes.push_back(graph.node(j).shape);
  return shapes;
}

const Kernel& choose_kernel(const Node& node, std::span<const Shape> inputs, Isa isa) {
  const Kernel* best = nullptr;
  for (const Kernel* kernel : node.op->kernels()) {
    if (!runs_at(kernel->isa(), isa) || !kernel->supports(*node.op, inputs, node.shape)) continue;
    if (best == nullptr || kernel->isa() > best->isa()) best = kernel;
  }
  if (best == nullptr)
    throw Error(ErrorKind::kInternal, "layer " + node.name + ": no kernel of " +
                                          std::string(node.op->type()) + " for the level " +
                                          std::string(name_of(isa)));
  return *best;
}

/// Nodes that depend on weights and constants only, and which of the nodes are read by a step or are outputs.
void find_constants(const Graph& graph, Plan& plan) {
  const std::size_t total = graph.nodes().size();
  plan.constant.assign(total, false);
  plan.needed.assign(total, false);
  for (std::size_t i = 0; i < total; ++i) {
    const Node& node = graph.nodes()[i];
    plan.constant[i] = node.kind == NodeKind::kParameter || node.kind == NodeKind::kConstant ||
                       (node.kind == NodeKind::kOp && !node.inputs.empty() &&
                        std::all_of(node.inputs.begin(), node.inputs.end(),
                                    [&](int j) { return plan.constant[static_cast<std::size_t>(j)]; }));
    if (plan.constant[i]) continue;
    for (const int j : node.inputs) plan.needed[static_cast<std::size_t>(j)] = true;
  }
  for (const auto& output : graph.outputs()) plan.needed[static_cast<std::size_t>(output.second)] = true;
}

}  // namespace

bool runs_at(Isa kernel, Isa isa) noexcept {
  if (kernel == Isa::kBaseline) return true;
  if (kernel == Isa::kNeon || isa == Isa::kNeon) return kernel == isa;
  return kernel <= isa;
}

Plan make_plan(const Graph& graph, Isa isa, bool keep_all) {
  Plan plan;
  plan.isa = isa;
  find_constants(graph, plan);
  const std::vector<int> last = last_uses(graph);
  const int total = static_cast<int>(graph.nodes().size());
  std::vector<ArenaBlock> blocks;  // result and scratch of each step, alternating
  for (int i = 0; i < total; ++i) {
    const std::size_t index = static_cast<std::size_t>(i);
    const Node& node = graph.nodes()[index];
    if (plan.constant[index] && plan.needed[index]) plan.weight_bytes += float_bytes(node.shape);
    if (plan.constant[index] || node.kind != NodeKind::kOp) continue;
    const std::vector<Shape> inputs = input_shapes(graph, node);
    const Kernel& kernel = choose_kernel(node, inputs, isa);
    const std::size_t scratch = kernel.scratch_bytes(*node.op, inputs, node.shape);
    plan.steps.push_back({i, &kernel, 0, 0, scratch});
    blocks.push_back({float_bytes(node.shape), i, keep_all ? total : last[index]});
    blocks.push_back({scratch, i, i});
  }
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
