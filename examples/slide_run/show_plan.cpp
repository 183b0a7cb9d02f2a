#include "examples/slide_run/show_plan.h"

#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "examples/slide_run/report.h"
#include "ops/conv2d/conv2d_expectation.h"
#include "runtime/text_table.h"

namespace slide::run {
namespace {

std::string fixed(double value, int digits) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

std::string scientific(double value) {
  char text[64];
  std::snprintf(text, sizeof text, "%.1e", value);
  return text;
}

std::string mebibytes(std::size_t bytes) { return fixed(static_cast<double>(bytes) / 1048576, 1) + " MiB"; }

/// Multiply-accumulates of a step: those its kernel does and those of the definition.
struct Macs {
  double done = 0, nominal = 0;
};

Macs macs_of(const Graph& graph, const PlanStep& step) {
  const Node& node = graph.node(step.node);
  std::vector<Shape> shapes;
  for (const int j : node.inputs) shapes.push_back(graph.node(j).shape);
  return {step.kernel->macs(*node.op, shapes, node.shape), node.op->macs(shapes, node.shape)};
}

/// The operator with its attributes, among them what was fused into it.
std::string operator_of(const Node& node) {
  const std::string attributes = node.op->attributes();
  return std::string(node.op->type()) + (attributes.empty() ? "" : " ") + attributes;
}

std::string table_of(const graphs::PlannedStage& stage) {
  using enum TextTable::Align;
  TextTable table(
      {"node", "operator", "kernel", "shape", "MMAC done", "nominal", "offset", "bytes", "scratch",
       "precision", "sensitivity", "error"},
      {kLeft, kLeft, kLeft, kLeft, kRight, kRight, kRight, kRight, kRight, kLeft, kRight, kRight});
  for (const PlanStep& step : stage.plan.steps) {
    const Node& node = stage.graph->node(step.node);
    const Macs macs = macs_of(*stage.graph, step);
    const auto bytes = static_cast<std::size_t>(node.shape.count()) * sizeof(float);
    table.row({node.name, operator_of(node), step.in_place ? "in place" : step.kernel->name_and_level(),
               node.shape.text(), fixed(1e-6 * macs.done, 3), fixed(1e-6 * macs.nominal, 3),
               std::to_string(step.offset), std::to_string(bytes), std::to_string(step.scratch_bytes),
               std::string(name_of(step.kernel->precision())), fixed(step.sensitivity, 1),
               scientific(step.predicted_error)});
  }
  return table.text();
}

std::string summary_of(const graphs::PlannedStage& stage) {
  Macs macs;
  for (const PlanStep& step : stage.plan.steps) {
    const Macs m = macs_of(*stage.graph, step);
    macs.done += m.done;
    macs.nominal += m.nominal;
  }
  const Plan& plan = stage.plan;
  return stage.report.name + ": " + std::to_string(plan.steps.size()) + " nodes, " +
         fixed(2e-9 * macs.done, 2) + " GFLOP done, " + fixed(2e-9 * macs.nominal, 2) + " nominal; " +
         mebibytes(plan.memory_bytes()) + " at its peak: " + mebibytes(plan.arena_bytes) +
         " of results and scratch memory (no placement could need less than " +
         mebibytes(plan.arena_lower_bound) + "), " + mebibytes(plan.weight_bytes) +
         " of weights; predicted error " + scientific(plan.predicted_error) + "\n";
}

}  // namespace

void print_plan(int height, int width, const graphs::SlideModels& models, const graphs::SlideInput& known,
                const graphs::SlideOptions& options) {
  std::printf("costs of convolutions: %s\n", std::string(ops::conv2d_costs().measured).c_str());
  std::size_t peak = 0;
  for (const graphs::PlannedStage& stage : graphs::plan_layers(height, width, models, known, options)) {
    std::printf("%s%s\n", summary_of(stage).c_str(), table_of(stage).c_str());
    peak = std::max(peak, stage.plan.memory_bytes());
  }
  std::printf("one stage after the other: %s at the peak, beside the photo and the layers\n",
              mebibytes(peak).c_str());
}

std::size_t resident_at_start() {
  static const std::size_t bytes = peak_memory();
  return bytes;
}

std::size_t planned_memory(std::size_t photo_pixels, int height, int width, const graphs::SlideModels& models,
                           const graphs::SlideInput& known, const graphs::SlideOptions& options) {
  const std::size_t pixels = static_cast<std::size_t>(height) * static_cast<std::size_t>(width);
  // float32 planes alive while a stage runs: the photo as read and as tensor 6, D D1 A S S_hat H matte 7,
  // background 4.
  constexpr std::size_t kStagePlanes = 6 + 7 + 4;
  // While views are drawn or encoded: both layers as images 9 and the copies that encoders make 12; for each
  // vertex of both meshes its place, disparity, texture and screen coordinates.
  constexpr std::size_t kDrawingBytes = (9 + 12) * sizeof(float) + 2 * 56;
  // Buffers of image files, palettes, threads' stacks, what an allocator keeps back.
  constexpr std::size_t kBuffers = std::size_t{32} << 20;
  std::size_t stage_memory = 0;
  for (const graphs::PlannedStage& stage : graphs::plan_layers(height, width, models, known, options))
    stage_memory = std::max(stage_memory, stage.plan.memory_bytes());
  const std::size_t reading = photo_pixels * 3 * 2 * sizeof(float);
  const std::size_t stages = pixels * kStagePlanes * sizeof(float) + stage_memory;
  return resident_at_start() + kBuffers + std::max({reading, stages, pixels * kDrawingBytes});
}

}  // namespace slide::run
