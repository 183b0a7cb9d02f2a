#include "benchmarks/eval/layerings.h"

#include <algorithm>

#include "graphs/stages.h"
#include "render/photo_layers.h"
#include "runtime/fast_executor.h"

namespace slide::eval {

Layers single_layer(const graphs::SlideLayers& made) {
  Layers layers = layers_from(made);
  layers.foreground.alpha = Image();
  layers.background.reset();
  return layers;
}

Layers hard_layers(const graphs::SlideLayers& made, const graphs::NetworkChoice& inpaint) {
  Layers layers = layers_from(made);
  if (!made.has_background()) return layers;
  for (float& a : layers.foreground.alpha.data) a = a < 0.5F ? 0.0F : 1.0F;
  Graph g;
  const Shape map = made.hole.shape();
  const graphs::Background b =
      graphs::inpaint_background(g.input("I", map.with(1, 3)), g.input("D1", map), g.input("S", map),
                                 g.input("H", map), inpaint, {.margin = graphs::fill_margin(map)});
  g.output("I_bg", b.image);
  g.output("D_bg", b.disparity);
  const WeightMap none("no weights");
  FastExecutor run(g, inpaint.chosen() ? *inpaint.weights : static_cast<const WeightSource&>(none));
  run.run({{"I", made.image}, {"D1", made.conditioned}, {"S", made.hole}, {"H", made.hole}});
  layers.background = Layer{image_from_tensor(run.tensor("I_bg")), image_from_tensor(run.tensor("D_bg")), {}};
  return layers;
}

void copy_background(graphs::SlideLayers& made) {
  if (!made.has_background()) return;
  Image colour = image_from_tensor(made.image);
  Image disparity = image_from_tensor(made.conditioned);
  const Image hole = image_from_tensor(made.hole);
  for (int y = 0; y < hole.height; ++y)
    for (int x = 0; x < hole.width; ++x) {
      if (!(hole.at(x, y) > 0)) continue;
      int end = x;
      while (end < hole.width && hole.at(end, y) > 0) ++end;
      const int left = std::max(0, x - 1);
      const int right = std::min(end, hole.width - 1);
      const int from = disparity.at(left, y) < disparity.at(right, y) ? left : right;
      for (; x < end; ++x) {
        for (int c = 0; c < 3; ++c) colour.at(x, y, c) = colour.at(from, y, c);
        disparity.at(x, y) = std::min(disparity.at(x, y), disparity.at(from, y));
      }
    }
  made.background_image = tensor_from_image(colour);
  made.background_disparity = tensor_from_image(disparity);
}

void LineFit::add(double d, double value) noexcept {
  n_ += 1;
  x_ += d;
  y_ += value;
  xx_ += d * d;
  xy_ += d * value;
}

PixelRange LineFit::result() const noexcept {
  const double variance = xx_ / n_ - x_ / n_ * (x_ / n_);
  const double range = variance > 0 ? std::max(0.0, (xy_ / n_ - x_ / n_ * (y_ / n_)) / variance) : 0.0;
  return {y_ / n_ - range * (x_ / n_), range};
}

}  // namespace slide::eval
