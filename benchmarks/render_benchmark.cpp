// Frames per second of two layers of a 672×1008 photo at 672×1008 on a circle of 4 percent parallax, with the
// full and with the adaptive mesh. The scene is made: discs with slanted, slightly curved surfaces before a
// rolling ground, edges softened over a few pixels, as a monocular network draws them, and a fine texture.
// Per frame the memory traffic that cannot be avoided is counted (vertices read, projected vertices written
// and read, textures read, view written) and set against what copying memory reaches on the same threads.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <optional>
#include <vector>

#include "render/camera_path.h"
#include "render/view.h"
#include "runtime/threads.h"

namespace slide {
namespace {

constexpr int kWidth = 672;
constexpr int kHeight = 1008;

struct Disc {
  double x, y, radius, disparity, slant;
};

/// Disparity of the scene without (background) or with the discs.
double scene_disparity(double x, double y, bool discs) {
  double d = 0.05 + 0.35 * y / kHeight + 0.02 * std::sin(x / 90.0) * std::cos(y / 130.0);
  if (!discs) return d;
  for (const Disc& disc : {Disc{200, 700, 150, 0.85, 1e-4}, Disc{480, 420, 110, 0.6, -2e-4},
                           Disc{330, 200, 70, 0.45, 3e-4}, Disc{560, 860, 60, 0.95, 0.0}}) {
    const double r = std::hypot(x - disc.x, y - disc.y);
    const double inside = 1.0 / (1.0 + std::exp((r - disc.radius) * 1.5));
    const double bulge = 0.03 * std::sqrt(std::max(0.0, 1.0 - r * r / (disc.radius * disc.radius)));
    d += inside * (disc.disparity + disc.slant * (x - disc.x) + bulge - d);
  }
  return std::clamp(d, 0.0, 1.0);
}

Layer scene_layer(bool discs) {
  Layer layer{Image(kWidth, kHeight, 3), Image(kWidth, kHeight, 1), Image(kWidth, kHeight, 1)};
  const double parallax = 0.04 * kWidth;
  const double beta = parallax * parallax / 12;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      layer.disparity.at(x, y) = static_cast<float>(scene_disparity(x, y, discs));
      const double gx = (scene_disparity(x + 1, y, discs) - scene_disparity(x - 1, y, discs)) / 2.0;
      const double gy = (scene_disparity(x, y + 1, discs) - scene_disparity(x, y - 1, discs)) / 2.0;
      layer.alpha.at(x, y) = static_cast<float>(std::exp(-beta * (gx * gx + gy * gy)));
      for (int c = 0; c < 3; ++c) {
        layer.colour.at(x, y, c) = static_cast<float>(0.5 + 0.4 * std::sin(0.7 * x + c) * std::sin(0.9 * y));
      }
    }
  }
  return layer;
}

const Layers& scene() {
  static const Layers layers{scene_layer(true), scene_layer(false)};
  return layers;
}

/// Bytes per second of copying 64 MiB back and forth with all threads, counting reads and writes.
double copy_bandwidth() {
  static const double result = [] {
    constexpr std::size_t kBytes = std::size_t{64} << 20;
    constexpr std::size_t kBlock = std::size_t{1} << 20;
    std::vector<char> from(kBytes, 1);
    std::vector<char> to(kBytes, 2);
    double best = 0.0;
    for (int i = 0; i < 5; ++i) {
      const auto start = std::chrono::steady_clock::now();
      parallel_for(kBytes / kBlock, [&](std::int64_t block) {
        const std::size_t offset = static_cast<std::size_t>(block) * kBlock;
        std::memcpy(to.data() + offset, from.data() + offset, kBlock);
      });
      const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
      benchmark::DoNotOptimize(to.data());
      best = std::max(best, 2.0 * kBytes / seconds.count());
    }
    return best;
  }();
  return result;
}

double frame_bytes(const ViewRenderer& renderer) {
  double vertices = 0.0;
  double indices = 0.0;
  for (const Mesh* mesh : {&renderer.foreground_mesh(), renderer.background_mesh()}) {
    vertices += static_cast<double>(mesh->u.size());
    indices += static_cast<double>(mesh->triangles.size());
  }
  const double pixels = double{kWidth} * kHeight;
  return vertices * (12.0 + 12.0 + 12.0) + indices * 12.0 + pixels * (2.0 * 16.0 + 12.0);
}

void render_circle(benchmark::State& state) {
  set_thread_count(static_cast<int>(state.range(1)));
  const Camera camera = make_camera(kWidth, kHeight);
  const std::vector<View> views = make_path(camera, PathOptions{});
  std::optional<double> tolerance;
  if (state.range(0) != 0) tolerance = mesh_tolerance(camera, views, 0.1);
  ViewRenderer renderer(scene(), camera, tolerance);
  Image out;
  std::size_t frame = 0;
  for (auto _ : state) {
    renderer.render(views[frame++ % views.size()], RenderOptions{}, out);
    benchmark::DoNotOptimize(out.data.data());
  }
  const auto frames = static_cast<double>(state.iterations());
  state.counters["fps"] = benchmark::Counter(frames, benchmark::Counter::kIsRate);
  state.counters["triangles"] = static_cast<double>(renderer.triangle_count());
  state.counters["bandwidth_fraction"] =
      benchmark::Counter(frames * frame_bytes(renderer) / copy_bandwidth(), benchmark::Counter::kIsRate);
  set_thread_count(0);
}

void build_adaptive_mesh(benchmark::State& state) {
  const Camera camera = make_camera(kWidth, kHeight);
  const double tolerance =
      mesh_tolerance(camera, make_path(camera, PathOptions{}), static_cast<double>(state.range(0)) / 1000.0);
  std::size_t triangles = 0;
  for (auto _ : state) triangles = adaptive_mesh(scene().foreground.disparity, tolerance).triangle_count();
  state.counters["triangles"] = static_cast<double>(triangles);
}

BENCHMARK(render_circle)
    ->ArgNames({"adaptive", "threads"})
    ->ArgsProduct({{0, 1}, {1, 2}})
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(build_adaptive_mesh)
    ->ArgName("thousandths_of_a_pixel")
    ->Arg(0)
    ->Arg(30)
    ->Arg(100)
    ->Arg(300)
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace slide
