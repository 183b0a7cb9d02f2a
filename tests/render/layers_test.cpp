#include "render/layers.h"

#include <doctest/doctest.h>

#include <limits>
#include <string>

#include "runtime/error.h"

namespace slide {
namespace {

Layers flat_layers(int width, int height) {
  Layers layers;
  layers.foreground.colour = Image(width, height, 3, 0.5F);
  layers.foreground.disparity = Image(width, height, 1, 0.25F);
  layers.foreground.alpha = Image(width, height, 1, 1.0F);
  layers.background = layers.foreground;
  return layers;
}

std::string refusal(const Layers& layers) {
  try {
    check_layers(layers);
  } catch (const Error& error) {
    CHECK(error.kind() == ErrorKind::kBadInput);
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("good layers pass, with and without alpha and background") {
  Layers layers = flat_layers(5, 4);
  CHECK(refusal(layers).empty());
  layers.foreground.alpha = Image();
  CHECK(refusal(layers).empty());
  layers.background.reset();
  CHECK(refusal(layers).empty());
}

TEST_CASE("NaN and infinite values are refused by layer, map and pixel") {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
                          -std::numeric_limits<float>::infinity()}) {
    Layers layers = flat_layers(5, 4);
    layers.foreground.disparity.at(3, 2) = bad;
    CHECK(refusal(layers).find("foreground disparity map") != std::string::npos);
    CHECK(refusal(layers).find("pixel (3, 2)") != std::string::npos);

    layers = flat_layers(5, 4);
    layers.background->colour.at(4, 3, 2) = bad;
    CHECK(refusal(layers).find("background colour map") != std::string::npos);
    CHECK(refusal(layers).find("pixel (4, 3)") != std::string::npos);
  }
}

TEST_CASE("disparity and alpha outside [0, 1] are refused") {
  Layers layers = flat_layers(5, 4);
  layers.foreground.alpha.at(0, 0) = 1.0001F;
  CHECK(refusal(layers).find("foreground alpha map") != std::string::npos);
  layers = flat_layers(5, 4);
  layers.background->disparity.at(0, 3) = -1e-6F;
  CHECK(refusal(layers).find("background disparity map") != std::string::npos);
}

TEST_CASE("maps of different sizes and layers without pixels are refused") {
  Layers layers = flat_layers(5, 4);
  layers.foreground.disparity = Image(4, 5, 1);
  CHECK(refusal(layers).find("4x5x1 where 5x4x1") != std::string::npos);
  layers = flat_layers(5, 4);
  layers.background->colour = Image(5, 4, 4);
  CHECK(refusal(layers).find("background colour") != std::string::npos);
  layers = flat_layers(5, 4);
  layers.foreground.colour.data.pop_back();
  CHECK_FALSE(refusal(layers).empty());
  CHECK_FALSE(refusal(Layers{}).empty());
  layers = flat_layers(kMaxLayerSide + 1, 1);
  CHECK_FALSE(refusal(layers).empty());
}

}  // namespace slide
