#include "examples/slide_run/show_plan.h"

#include <algorithm>
#include <cstdio>

#include "examples/slide_run/report.h"

namespace slide::run {
namespace {

void print_step(const Graph& graph, const PlanStep& step) {
  const Node& node = graph.node(step.node);
  std::vector<Shape> shapes;
  for (const int j : node.inputs) shapes.push_back(graph.node(j).shape);
  const std::string kernel =
      std::string(step.kernel->name()) + "." + std::string(name_of(step.kernel->isa()));
  std::printf("  %-52s %-28s %-16s %10.3f M %12zu\n", node.name.c_str(), kernel.c_str(),
              node.shape.text().c_str(), 1e-6 * node.op->macs(shapes, node.shape), step.offset);
}

}  // namespace

void print_plan(int height, int width, const graphs::SlideModels& models, const graphs::SlideInput& known,
                const graphs::SlideOptions& options) {
  for (const graphs::PlannedStage& stage : graphs::plan_layers(height, width, models, known, options)) {
    std::printf(
        "%s: %zu nodes, %.2f GFLOP, %.1f MiB of results (no placement could need less than %.1f), %.1f MiB "
        "of weights\n",
        stage.report.name.c_str(), stage.plan.steps.size(), stage.report.gflop,
        static_cast<double>(stage.plan.arena_bytes) / 1048576,
        static_cast<double>(stage.plan.arena_lower_bound) / 1048576,
        static_cast<double>(stage.plan.weight_bytes) / 1048576);
    std::printf("  %-52s %-28s %-16s %12s %12s\n", "node", "kernel", "shape", "MAC", "offset");
    for (const PlanStep& step : stage.plan.steps) print_step(*stage.graph, step);
  }
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
