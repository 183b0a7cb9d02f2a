#include "benchmarks/eval/matte_scene.h"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "render/image_file.h"
#include "runtime/error.h"

namespace slide::eval {
namespace {

constexpr std::string_view kAlphaEnding = "_alpha.png";
constexpr int kCoreMargin = 4;
constexpr float kTransparent = 0.02F;
constexpr float kOpaque = 0.98F;
constexpr float kWhole = 0.999F;

template <typename F>
Image mapped(const Image& image, F f) {
  Image out = image;
  for (float& v : out.data) v = f(v);
  return out;
}

/// Moved to the right; zeros come in.
Image moved(const Image& image, int shift) {
  Image out(image.width, image.height, image.channels);
  for (int y = 0; y < image.height; ++y)
    for (int x = std::max(0, shift); x < std::min(image.width, image.width + shift); ++x)
      for (int c = 0; c < image.channels; ++c) out.at(x, y, c) = image.at(x - shift, y, c);
  return out;
}

Image over(const Image& front, const Image& alpha, const Image& back) {
  Image out = back;
  for (std::size_t i = 0; i < out.data.size(); ++i) {
    const double a = static_cast<double>(alpha.data[i / 3]);
    out.data[i] = static_cast<float>(static_cast<double>(front.data[i]) * a +
                                     static_cast<double>(back.data[i]) * (1 - a));
  }
  return out;
}

/// 1 within `steps` along rows and columns of a pixel that is 1 (binary dilation by a cross, repeated).
Image dilated(Image mask, int steps) {
  for (int step = 0; step < steps; ++step) {
    Image out = mask;
    for (int y = 0; y < mask.height; ++y)
      for (int x = 0; x < mask.width; ++x) {
        if (x > 0) out.at(x, y) = std::max(out.at(x, y), mask.at(x - 1, y));
        if (x + 1 < mask.width) out.at(x, y) = std::max(out.at(x, y), mask.at(x + 1, y));
        if (y > 0) out.at(x, y) = std::max(out.at(x, y), mask.at(x, y - 1));
        if (y + 1 < mask.height) out.at(x, y) = std::max(out.at(x, y), mask.at(x, y + 1));
      }
    mask = std::move(out);
  }
  return mask;
}

Image outline(const MatteScene& scene) {
  Image out = dilated(true_disparity(scene), 1);
  for (std::size_t i = 0; i < out.data.size(); ++i) {
    const float a = scene.alpha.data[i];
    out.data[i] = (a > kTransparent && a < kOpaque) || (out.data[i] > 0 && !(a > 0.5F)) ? 1.0F : 0.0F;
  }
  return out;
}

/// The median of the disparities where `chosen` says so; of an even number the mean of the middle two.
template <typename F>
double median_where(const MatteScene& scene, const Image& disparity, F chosen) {
  std::vector<float> values;
  for (std::size_t i = 0; i < disparity.data.size(); ++i)
    if (chosen(scene.alpha.data[i])) values.push_back(disparity.data[i]);
  if (values.empty())
    throw Error(ErrorKind::kBadInput,
                scene.name + kAlphaEnding.data() + " is nowhere clear, or nowhere opaque");
  std::ranges::sort(values);
  const std::size_t n = values.size();
  return (static_cast<double>(values[(n - 1) / 2]) + static_cast<double>(values[n / 2])) / 2;
}

}  // namespace

MatteScene read_matte_scene(const std::string& alpha_file) {
  const std::string stem = alpha_file.substr(0, alpha_file.size() - kAlphaEnding.size());
  MatteScene scene;
  scene.name = stem.substr(stem.find_last_of('/') + 1);
  scene.alpha = read_map(alpha_file);
  const auto layer = [&](const std::string& file) {
    Image picture = read_photo(file).colour;
    if (picture.width != scene.alpha.width || picture.height != scene.alpha.height)
      throw Error(ErrorKind::kBadInput, file + " differs in size from " + alpha_file);
    return picture;
  };
  scene.foreground = layer(stem + "_fg.jpg");
  scene.background = layer(stem + "_bg.jpg");
  scene.photo = mapped(over(scene.foreground, scene.alpha, scene.background),
                       [](float v) { return std::nearbyint(v * 255) / 255; });
  return scene;
}

Camera matte_camera(const MatteScene& scene) {
  return make_camera(scene.alpha.width, scene.alpha.height, kDefaultFov, 1, 1e6);
}

View matte_view(const MatteScene& scene, int shift) {
  View view;
  view.pose.translation.x = static_cast<double>(shift) / matte_camera(scene).focal;
  return view;
}

Image true_view(const MatteScene& scene, int shift) {
  return over(moved(scene.foreground, shift), moved(scene.alpha, shift), scene.background);
}

Image rim(const MatteScene& scene) { return dilated(outline(scene), kRimWidth); }

Image rim_of_view(const MatteScene& scene, int shift) {
  const Image here = outline(scene);
  const Image there = moved(here, shift);
  Image both = here;
  for (std::size_t i = 0; i < both.data.size(); ++i) both.data[i] = std::max(here.data[i], there.data[i]);
  Image out = dilated(std::move(both), kRimWidth);
  const int side = std::abs(shift) + 2;
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x)
      if (x < side || x >= out.width - side) out.at(x, y) = 0;
  return out;
}

Image core(const MatteScene& scene) {
  // Beyond the picture nothing is whole: a frame of one pixel, cut off again.
  Image frayed(scene.alpha.width + 2, scene.alpha.height + 2, 1, 1);
  for (int y = 0; y < scene.alpha.height; ++y)
    for (int x = 0; x < scene.alpha.width; ++x)
      frayed.at(x + 1, y + 1) = scene.alpha.at(x, y) >= kWhole ? 0.0F : 1.0F;
  frayed = dilated(std::move(frayed), kCoreMargin);
  Image out(scene.alpha.width, scene.alpha.height, 1);
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x) out.at(x, y) = 1 - frayed.at(x + 1, y + 1);
  return out;
}

Image fitted_disparity(const MatteScene& scene, const Image& disparity) {
  const double far = median_where(scene, disparity, [](float a) { return a < kTransparent; });
  const double near = median_where(scene, disparity, [](float a) { return a > kOpaque; });
  const Image inside = rim(scene);
  Image out = true_disparity(scene);
  for (std::size_t i = 0; i < out.data.size(); ++i)
    if (inside.data[i] > 0)
      out.data[i] = static_cast<float>(
          std::clamp((static_cast<double>(disparity.data[i]) - far) / std::max(near - far, 1e-3), 0.0, 1.0));
  return out;
}

Image true_disparity(const MatteScene& scene) {
  return mapped(scene.alpha, [](float a) { return a > 0.5F ? 1.0F : 0.0F; });
}

}  // namespace slide::eval
