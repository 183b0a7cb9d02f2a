#include "examples/slide_run/show_plan.h"

#include <algorithm>
#include <cstdio>

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

std::size_t planned_memory(int height, int width, const graphs::SlideModels& models,
                           const graphs::SlideInput& known, const graphs::SlideOptions& options) {
  const std::size_t pixels = static_cast<std::size_t>(height) * static_cast<std::size_t>(width);
  // float32 planes that live through the run: the photo twice (as read, as tensor) 6, D D1 A S S_hat H matte
  // 7, background 4, the same as images for the rasterizer 9.
  constexpr std::size_t kPlanes = 6 + 7 + 4 + 9;
  // Both full meshes: place, disparity, screen coordinates and texture coordinates of each vertex.
  constexpr std::size_t kMeshBytes = 2 * 48;
  constexpr std::size_t kProgram = std::size_t{32} << 20;  // code, libraries, buffers of image files
  std::size_t largest = pixels * kMeshBytes;
  for (const graphs::PlannedStage& stage : graphs::plan_layers(height, width, models, known, options))
    largest = std::max(largest, stage.plan.memory_bytes());
  return kProgram + pixels * kPlanes * sizeof(float) + largest;
}

}  // namespace slide::run
