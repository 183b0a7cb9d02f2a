#include "render/layers.h"

#include <cmath>
#include <string>

#include "runtime/error.h"

namespace slide {
namespace {

std::string size_of(const Image& image) {
  return std::to_string(image.width) + "x" + std::to_string(image.height) + "x" +
         std::to_string(image.channels);
}

void check_map(const Image& map, const std::string& name, int width, int height, int channels,
               bool unit_range) {
  const bool consistent =
      map.data.size() == map.pixels() * static_cast<std::size_t>(map.channels > 0 ? map.channels : 0);
  if (map.width != width || map.height != height || map.channels != channels || !consistent) {
    throw Error(ErrorKind::kBadInput, "the " + name + " map is " + size_of(map) + " where " +
                                          std::to_string(width) + "x" + std::to_string(height) + "x" +
                                          std::to_string(channels) + " is needed");
  }
  for (std::size_t i = 0; i < map.data.size(); ++i) {
    const float v = map.data[i];
    const bool good = unit_range ? (v >= 0.0F && v <= 1.0F) : std::isfinite(v);
    if (!good) {
      const std::size_t pixel = i / static_cast<std::size_t>(channels);
      const auto w = static_cast<std::size_t>(width);
      throw Error(ErrorKind::kBadInput, "the " + name + " map holds " + std::to_string(v) + " at pixel (" +
                                            std::to_string(pixel % w) + ", " + std::to_string(pixel / w) +
                                            ")" + (unit_range ? ", which is not in [0, 1]" : ""));
    }
  }
}

void check_layer(const Layer& layer, const std::string& name, int width, int height) {
  check_map(layer.colour, name + " colour", width, height, 3, false);
  check_map(layer.disparity, name + " disparity", width, height, 1, true);
  if (!layer.alpha.empty()) check_map(layer.alpha, name + " alpha", width, height, 1, true);
}

}  // namespace

void check_layers(const Layers& layers) {
  const int width = layers.foreground.colour.width;
  const int height = layers.foreground.colour.height;
  if (width < 1 || height < 1 || width > kMaxLayerSide || height > kMaxLayerSide) {
    throw Error(ErrorKind::kBadInput, "the foreground colour map is " + size_of(layers.foreground.colour) +
                                          ", outside 1x1 to " + std::to_string(kMaxLayerSide) + "x" +
                                          std::to_string(kMaxLayerSide));
  }
  check_layer(layers.foreground, "foreground", width, height);
  if (layers.background) check_layer(*layers.background, "background", width, height);
}

}  // namespace slide
