#include "runtime/plan.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <optional>
#include <utility>

#include "runtime/arena.h"
#include "runtime/error.h"
#include "runtime/error_model.h"
#include "runtime/lifetime.h"
#include "runtime/sensitivity.h"
#include "runtime/storage.h"

namespace slide {
namespace {

std::size_t float_bytes(const Shape& shape) {
  return static_cast<std::size_t>(shape.count()) * sizeof(float);
}

bool usable(const Kernel& kernel, const Node& node, std::span<const Shape> inputs, Isa isa) {
  return runs_at(kernel.isa(), isa) && kernel.supports(*node.op, inputs, node.shape);
}

/// The first kernel of the highest level, of `precision` or one that replaces it, if there is any; else, or
/// if that is predicted to be faster, of float32. `only`: nothing is replaced, be it faster.
const Kernel& choose_kernel(const Node& node, std::span<const Shape> inputs, Isa isa, Precision precision,
                            bool only = false) {
  const Kernel* best = nullptr;
  const auto better = [&](const Kernel& kernel) {
    if (best == nullptr) return true;
    const bool low = kernel.precision() != Precision::kFp32;
    if (low != (best->precision() != Precision::kFp32)) return low;
    return kernel.isa() > best->isa();
  };
  for (const Kernel* kernel : node.op->kernels()) {
    const bool allowed =
        kernel->precision() == precision || kernel->precision() == Precision::kFp32 ||
        (!only && kernel->precision() < precision && kernel->replaces_lower(*node.op, inputs));
    if (allowed && usable(*kernel, node, inputs, isa) && better(*kernel)) best = kernel;
  }
  if (best == nullptr)
    throw Error(ErrorKind::kInternal, "layer " + node.name + ": no kernel of " +
                                          std::string(node.op->type()) + " for the level " +
                                          std::string(name_of(isa)));
  if (best->precision() != Precision::kFp32 && !only) {
    const Kernel& exact = choose_kernel(node, inputs, isa, Precision::kFp32);
    if (exact.cost(*node.op, inputs, node.shape) < best->cost(*node.op, inputs, node.shape)) return exact;
  }
  return *best;
}

/// Of each method in `precision` or a higher one the kernel of the highest level.
std::vector<const Kernel*> methods(const Node& node, std::span<const Shape> inputs, Isa isa,
                                   Precision precision) {
  std::vector<const Kernel*> found;
  for (const Kernel* kernel : node.op->kernels()) {
    if (kernel->precision() > precision || !usable(*kernel, node, inputs, isa)) continue;
    const auto same = std::find_if(found.begin(), found.end(),
                                   [&](const Kernel* other) { return other->name() == kernel->name(); });
    if (same == found.end())
      found.push_back(kernel);
    else if (kernel->isa() > (*same)->isa())
      *same = kernel;
  }
  return found;
}

bool is_step(const Graph& graph, const Plan& plan, int i) {
  return graph.node(i).kind == NodeKind::kOp && !plan.constant[static_cast<std::size_t>(i)];
}

/// The error of a kernel of 8-bit integers for that node, which is what a calibration measured; 0 if it has
/// none.
double int8_error(const Node& node, std::span<const Shape> inputs) {
  for (const Kernel* kernel : node.op->kernels())
    if (kernel->precision() == Precision::kInt8 && kernel->supports(*node.op, inputs, node.shape))
      return kernel->expected_error(*node.op, inputs);
  return 0;
}

/// What a kernel of lower precision adds to the outputs by the calibration, in proportion to what it adds
/// beside one of 8-bit integers; nothing where the layer was not calibrated.
std::optional<double> calibrated_error(const Graph& graph, int i, const Kernel& kernel,
                                       const PlanOptions& options) {
  if (kernel.precision() == Precision::kFp32 || options.calibration == nullptr) return std::nullopt;
  const LayerCalibration* layer = options.calibration->find(graph, i);
  if (layer == nullptr) return std::nullopt;
  const std::vector<Shape> inputs = input_shapes(graph, graph.node(i));
  const double measured = int8_error(graph.node(i), inputs);
  if (!(measured > 0)) return std::nullopt;
  return kCalibrationMargin * layer->error * kernel.expected_error(*graph.node(i).op, inputs) / measured;
}

/// How many times its expected error each node's kernel may make, where weights tell.
std::vector<double> sensitivities_of(const Graph& graph, const Plan& plan, const PlanOptions& options) {
  if (options.weights != nullptr && options.calibration == nullptr && options.precision != Precision::kFp32)
    return find_sensitivities(graph, plan.constant, *options.weights);
  return std::vector<double>(graph.nodes().size(), 1);
}

/// Whether a layer's sums cancel so far that a kernel's own error is expected to spoil its result.
bool spoils(const Node& node, std::span<const Shape> inputs, const Kernel& kernel, double sensitivity) {
  return kernel.precision() != Precision::kFp32 && sensitivity > 1 &&
         sensitivity * kernel.expected_error(*node.op, inputs) > kLayerError;
}

/// What a node's error is multiplied by on its way to the outputs.
struct Errors {
  std::vector<double> shares;  ///< error_shares(), of squares
  std::vector<double> own;     ///< find_sensitivities(), of kernels below float32
};

/// What a kernel's error is expected to be where it reaches the outputs.
double error_at_output(const Graph& graph, int i, const Kernel& kernel, const Errors& errors,
                       const PlanOptions& options) {
  if (const std::optional<double> error = calibrated_error(graph, i, kernel, options)) return *error;
  const Node& node = graph.node(i);
  const auto at = static_cast<std::size_t>(i);
  const double own = kernel.precision() == Precision::kFp32 ? 1 : errors.own[at];
  return std::sqrt(errors.shares[at]) * own * kernel.expected_error(*node.op, input_shapes(graph, node));
}

bool not_calibrated(const Graph& graph, int i, const PlanOptions& options) {
  return options.calibration != nullptr && options.calibration->find(graph, i) == nullptr;
}

using Kernels = std::vector<const Kernel*>;  // by node; null for those that are not computed at a run

/// What a node is computed with where its calibrated error, whose square is given, is too large: the next
/// precision that makes less than half of the square of it.
const Kernel* raised(const Graph& graph, const Plan& plan, const PlanOptions& options, int i, double square) {
  const Node& node = graph.node(i);
  const auto kernel_of = [&](Precision precision) {
    return &choose_kernel(node, input_shapes(graph, node), plan.isa, precision, options.only_precision);
  };
  const Kernel* kernel = options.precision > Precision::kBf16 ? kernel_of(Precision::kBf16) : nullptr;
  if (kernel != nullptr) {
    const double error = calibrated_error(graph, i, *kernel, options).value_or(0);
    if (2 * error * error < square) return kernel;
  }
  return kernel_of(Precision::kFp32);
}

/// Raises the precision of the nodes with the largest calibrated errors until all together are within
/// `limit`.
void raise_within(const Graph& graph, const Plan& plan, const PlanOptions& options, double limit,
                  Kernels& kernels) {
  std::vector<double> squares(kernels.size(), 0);
  const auto find_square = [&](std::size_t i) {
    const double error = calibrated_error(graph, static_cast<int>(i), *kernels[i], options).value_or(0);
    squares[i] = error * error;
  };
  for (std::size_t i = 0; i < kernels.size(); ++i)
    if (kernels[i] != nullptr) find_square(i);
  while (std::accumulate(squares.begin(), squares.end(), 0.0) > limit * limit) {
    const auto worst = static_cast<std::size_t>(std::ranges::max_element(squares) - squares.begin());
    kernels[worst] = raised(graph, plan, options, static_cast<int>(worst), squares[worst]);
    find_square(worst);
  }
}

/// Without a budget. What a calibration does not know is computed in float32; without a calibration the ends
/// of a network of 8-bit integers are, and layers that lower precisions would spoil.
Kernels kernels_of(const Graph& graph, const Plan& plan, const PlanOptions& options,
                   const std::vector<double>& own) {
  Kernels kernels(graph.nodes().size(), nullptr);
  std::vector<bool> low(kernels.size(), false);
  const auto choose = [&](std::size_t i, Precision precision) {
    const Node& node = graph.nodes()[i];
    kernels[i] = &choose_kernel(node, input_shapes(graph, node), plan.isa, precision, options.only_precision);
  };
  for (std::size_t i = 0; i < kernels.size(); ++i) {
    if (!is_step(graph, plan, static_cast<int>(i))) continue;
    const bool unknown = not_calibrated(graph, static_cast<int>(i), options);
    choose(i, unknown ? Precision::kFp32 : options.precision);
    const Node& node = graph.nodes()[i];
    const auto spoiled = [&] { return spoils(node, input_shapes(graph, node), *kernels[i], own[i]); };
    if (spoiled()) choose(i, Precision::kBf16);
    if (spoiled()) choose(i, Precision::kFp32);
    low[i] = kernels[i]->precision() != Precision::kFp32;
  }
  const bool int8 = options.precision == Precision::kInt8;
  if (options.calibration != nullptr) {
    raise_within(graph, plan, options, int8 ? kInt8Error : kBf16Error, kernels);
  } else if (int8) {
    const std::vector<bool> ends = network_ends(graph, low);
    for (std::size_t i = 0; i < kernels.size(); ++i)
      if (ends[i]) choose(i, Precision::kFp32);
  }
  return kernels;
}

std::string scientific(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2g", value);
  return text;
}

Kernels kernels_within(const Graph& graph, const Plan& plan, const PlanOptions& options,
                       const Errors& errors) {
  std::vector<std::size_t> nodes;
  std::vector<std::vector<KernelChoice>> choices;
  for (std::size_t i = 0; i < graph.nodes().size(); ++i) {
    if (!is_step(graph, plan, static_cast<int>(i))) continue;
    const Node& node = graph.nodes()[i];
    const std::vector<Shape> inputs = input_shapes(graph, node);
    (void)choose_kernel(node, inputs, plan.isa, Precision::kFp32);  // there is one
    std::vector<KernelChoice>& of_node = choices.emplace_back();
    for (const Kernel* kernel : methods(node, inputs, plan.isa, options.precision)) {
      if (kernel->precision() == Precision::kInt8 && not_calibrated(graph, static_cast<int>(i), options))
        continue;
      if (spoils(node, inputs, *kernel, errors.own[i])) continue;
      const double error = error_at_output(graph, static_cast<int>(i), *kernel, errors, options);
      of_node.push_back({kernel, error * error, kernel->cost(*node.op, inputs, node.shape)});
    }
    nodes.push_back(i);
  }
  const double limit = options.error_budget * options.error_budget;
  const std::vector<std::size_t> chosen = choose_within(choices, limit);
  Kernels kernels(graph.nodes().size(), nullptr);
  double square = 0;
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    const KernelChoice& choice = choices[n][chosen[n]];
    kernels[nodes[n]] = choice.kernel;
    square += choice.square;
  }
  if (square > limit * (1 + 1e-9))
    throw Error(ErrorKind::kUsage,
                "an error of " + scientific(options.error_budget) +
                    " is out of reach: the most exact kernels are expected to make " +
                    scientific(std::sqrt(square)),
                "allow a larger error");
  return kernels;
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

PlanStep plan_step(const Graph& graph, const Plan& plan, int i, const Kernel& kernel) {
  const Node& node = graph.node(i);
  const std::vector<Shape> inputs = input_shapes(graph, node);
  const std::size_t packed = Tensor::aligned(kernel.packed_bytes(*node.op, inputs, node.shape));
  const bool once = packs_constants(plan, node, kernel);
  const std::size_t scratch = kernel.scratch_bytes(*node.op, inputs, node.shape);
  return {i, &kernel, 0, 0, once ? scratch : packed + scratch, packed, once, 0, 1, false};
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

/// Gives the steps' results and scratch memory their places in the arena.
void place_steps(const Graph& graph, const Storage& storage, Plan& plan) {
  std::vector<ArenaBlock> blocks;  // of all scratch memory, then of results
  for (const PlanStep& step : plan.steps) blocks.push_back({step.scratch_bytes, step.node, step.node});
  std::vector<std::size_t> block_of(storage.places.size());
  for (const PlanStep& step : plan.steps) {
    const auto i = static_cast<std::size_t>(step.node);
    if (storage.places[i].block != step.node) continue;
    block_of[i] = blocks.size();
    blocks.push_back({float_bytes(graph.node(step.node).shape), storage.first[i], storage.last[i]});
  }
  const ArenaLayout layout = place(blocks);
  plan.arena_bytes = layout.bytes;
  plan.arena_lower_bound = lower_bound(blocks);
  for (std::size_t s = 0; s < plan.steps.size(); ++s) {
    PlanStep& step = plan.steps[s];
    const Place& at = storage.places[static_cast<std::size_t>(step.node)];
    step.scratch_offset = layout.offsets[s];
    step.offset = layout.offsets[block_of[static_cast<std::size_t>(at.block)]] + at.offset;
    step.in_place = in_place(graph, storage, step.node);
  }
}

/// With shared storage, unless gaps between blocks of other sizes make that larger.
void place_steps(const Graph& graph, bool keep_all, Plan& plan) {
  const std::vector<int> last = last_uses(graph);
  const int total = static_cast<int>(graph.nodes().size());
  std::vector<StoredNode> stored;
  for (const PlanStep& step : plan.steps)
    stored.push_back(
        {step.node, keep_all ? total : last[static_cast<std::size_t>(step.node)], step.scratch_bytes});
  Plan copying = plan;
  place_steps(graph, share_storage(graph, stored, false), copying);
  place_steps(graph, share_storage(graph, stored), plan);
  if (plan.arena_bytes > copying.arena_bytes) plan = std::move(copying);
}

}  // namespace

Plan make_plan(const Graph& graph, const PlanOptions& options) {
  Plan plan;
  plan.isa = options.isa;
  find_constants(graph, plan);
  const Errors errors{error_shares(graph, plan.constant), sensitivities_of(graph, plan, options)};
  const Kernels kernels = options.error_budget > 0 ? kernels_within(graph, plan, options, errors)
                                                   : kernels_of(graph, plan, options, errors.own);
  const int total = static_cast<int>(graph.nodes().size());
  plan.needed.assign(static_cast<std::size_t>(total), false);
  for (const auto& output : graph.outputs()) plan.needed[static_cast<std::size_t>(output.second)] = true;
  double square = 0;
  for (int i = 0; i < total; ++i) {
    const std::size_t index = static_cast<std::size_t>(i);
    if (kernels[index] == nullptr) continue;
    plan.steps.push_back(plan_step(graph, plan, i, *kernels[index]));
    double& error = plan.steps.back().predicted_error;
    error = error_at_output(graph, i, *kernels[index], errors, options);
    plan.steps.back().sensitivity = errors.own[index];
    square += error * error;
    mark_needed(graph, plan.steps.back(), plan);
  }
  plan.predicted_error = std::sqrt(square);
  plan.weight_bytes = weight_bytes(graph, plan);
  place_steps(graph, options.keep_all, plan);
  return plan;
}

Plan make_plan(const Graph& graph, Isa isa, bool keep_all, Precision precision) {
  return make_plan(graph, PlanOptions{.isa = isa, .keep_all = keep_all, .precision = precision});
}

}  // namespace slide
