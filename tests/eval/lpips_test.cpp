#include "graphs/lpips.h"

#include <doctest/doctest.h>

#include <cmath>
#include <cstdlib>

#include "benchmarks/eval/result.h"
#include "graphs/formula_weights.h"
#include "render/photo_layers.h"
#include "runtime/error.h"
#include "runtime/reference_executor.h"

using namespace slide;

// The number is that of tests/oracles/make_lpips.py: PyTorch in float64 with the same weights.
namespace {

constexpr int kWidth = 79;
constexpr int kHeight = 71;
constexpr double kDistance = -0.0134332819456567;  // made-up heads have both signs

int triangle(int t, int half) { return std::abs(t % (2 * half) - half) * 255 / half; }

Image picture(int move) {
  Image out(kWidth, kHeight, 3);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (int c = 0; c < 3; ++c) {
        const int v = (triangle((x + move) * (c + 2) + y, 23) + triangle(3 * y + (x + move) * c, 37)) / 2;
        out.at(x, y, c) = static_cast<float>(v) / 255;
      }
  return out;
}

}  // namespace

TEST_CASE("LPIPS gives PyTorch's number, and the kernels come close to it") {
  const Image a = picture(0);
  const Image b = picture(4);
  const graphs::FormulaWeights formula = graphs::FormulaWeights::made_up();
  Graph g;
  const Shape shape{1, 3, kHeight, kWidth};
  g.output("distance", graphs::lpips_alex(g.input("a", shape), g.input("b", shape)));
  ReferenceExecutor run(g, formula);
  run.run({{"a", tensor_from_image(a)}, {"b", tensor_from_image(b)}});
  CHECK(std::fabs(run.tensor("distance").data<double>()[0] - kDistance) < 1e-12);
  CHECK(std::fabs(eval::lpips_distance(a, b, formula) - kDistance) < 1e-6);
  CHECK(eval::lpips_distance(a, a, formula) == 0);
}

TEST_CASE("LPIPS refuses pictures that differ in size or are too small") {
  Graph g;
  const Value a = g.input("a", {1, 3, 64, 64});
  CHECK_THROWS_AS(graphs::lpips_alex(a, g.input("b", {1, 3, 64, 65})), Error);
  CHECK_THROWS_AS(graphs::lpips_alex(g.input("c", {1, 3, 62, 64}), g.input("d", {1, 3, 62, 64})), Error);
}
