#pragma once

#include <cmath>

#include "render/layers.h"

/// A scene whose picture tells near from far: a red square (disparity 1, a third of the height) before a wall
/// with green and dark vertical stripes (disparity 0). The background layer is the wall without the square.
/// The square's height field falls to the wall over two pixels; the visibility there, and in one pixel on
/// either side, is 0.
inline slide::Layers sample_scene(int width, int height) {
  using slide::Image;
  slide::Layers layers;
  slide::Layer wall;
  wall.colour = Image(width, height, 3);
  wall.disparity = Image(width, height, 1, 0.0F);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const bool lit = x * 16 / width % 2 == 0;
      wall.colour.at(x, y, 0) = 0.05F;
      wall.colour.at(x, y, 1) = lit ? 0.8F : 0.2F;
      wall.colour.at(x, y, 2) = 0.1F;
    }
  }
  layers.foreground = wall;
  layers.foreground.alpha = Image(width, height, 1, 1.0F);
  const int half = height / 6;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int d = std::max(std::abs(x - width / 2), std::abs(y - height / 2));
      if (d > half + 3) continue;
      if (d <= half + 1) {
        layers.foreground.colour.at(x, y, 0) = 0.9F;
        layers.foreground.colour.at(x, y, 1) = 0.1F;
      }
      layers.foreground.disparity.at(x, y) = d <= half + 1 ? 1.0F : d == half + 2 ? 0.5F : 0.0F;
      layers.foreground.alpha.at(x, y) = d <= half ? 1.0F : 0.0F;
    }
  }
  layers.background = wall;
  return layers;
}
