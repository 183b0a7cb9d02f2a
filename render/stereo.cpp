#include "render/stereo.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <utility>

#include "runtime/error.h"

namespace slide {
namespace {

using Matrix = std::array<std::array<double, 3>, 3>;

constexpr Matrix kLeft = {{{0.456100, 0.500484, 0.176381},
                           {-0.0400822, -0.0378246, -0.0157589},
                           {-0.0152161, -0.0205971, -0.00546856}}};
constexpr Matrix kRight = {{{-0.0434706, -0.0879388, -0.00155529},
                            {0.378476, 0.73364, -0.0184503},
                            {-0.0721527, -0.112961, 1.2264}}};

void require_pair(const Image& left, const Image& right) {
  if (left.width != right.width || left.height != right.height || left.channels != 3 || right.channels != 3) {
    throw Error(ErrorKind::kInternal, "a stereo pair needs two colour views of one size");
  }
}

double linear_from_srgb(float v) {
  const double x = v > 0 ? std::min(v, 1.0F) : 0.0;
  return x <= 0.04045 ? x / 12.92 : std::pow((x + 0.055) / 1.055, 2.4);
}

float srgb_from_linear(double v) {
  const double x = std::clamp(v, 0.0, 1.0);
  return static_cast<float>(x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055);
}

}  // namespace

Image side_by_side(const Image& left, const Image& right) {
  require_pair(left, right);
  Image out(2 * left.width, left.height, 3);
  const auto row_values = static_cast<std::ptrdiff_t>(3) * left.width;
  for (int y = 0; y < left.height; ++y) {
    float* row = std::copy(left.row(y), left.row(y) + row_values, out.row(y));
    std::copy(right.row(y), right.row(y) + row_values, row);
  }
  return out;
}

Image top_bottom(const Image& left, const Image& right) {
  require_pair(left, right);
  Image out(left.width, 2 * left.height, 3);
  std::copy(right.data.begin(), right.data.end(),
            std::copy(left.data.begin(), left.data.end(), out.data.begin()));
  return out;
}

Image half_width(const Image& view) {
  Image out((view.width + 1) / 2, view.height, view.channels);
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x)
      for (int c = 0; c < out.channels; ++c)
        out.at(x, y, c) = (view.at(2 * x, y, c) + view.at(std::min(2 * x + 1, view.width - 1), y, c)) / 2;
  return out;
}

Image half_height(const Image& view) {
  Image out(view.width, (view.height + 1) / 2, view.channels);
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x)
      for (int c = 0; c < out.channels; ++c)
        out.at(x, y, c) = (view.at(x, 2 * y, c) + view.at(x, std::min(2 * y + 1, view.height - 1), c)) / 2;
  return out;
}

StereoKind stereo_kind(const std::string& name) {
  constexpr std::array<std::pair<std::string_view, StereoKind>, 6> kNames = {
      {{"sbs", StereoKind::kSideBySide},
       {"half-sbs", StereoKind::kHalfSideBySide},
       {"cross", StereoKind::kCrossEyed},
       {"tb", StereoKind::kTopBottom},
       {"half-tb", StereoKind::kHalfTopBottom},
       {"anaglyph", StereoKind::kAnaglyph}}};
  for (const auto& [known, kind] : kNames)
    if (name == known) return kind;
  throw Error(ErrorKind::kUsage, "there is no stereo picture of the kind " + name,
              "one of: sbs, half-sbs, cross, tb, half-tb, anaglyph");
}

Image stereo_picture(StereoKind kind, const Image& left, const Image& right) {
  switch (kind) {
    case StereoKind::kSideBySide:
      return side_by_side(left, right);
    case StereoKind::kHalfSideBySide:
      return side_by_side(half_width(left), half_width(right));
    case StereoKind::kCrossEyed:
      return side_by_side(right, left);
    case StereoKind::kTopBottom:
      return top_bottom(left, right);
    case StereoKind::kHalfTopBottom:
      return top_bottom(half_height(left), half_height(right));
    case StereoKind::kAnaglyph:
      return anaglyph(left, right);
  }
  throw Error(ErrorKind::kInternal, "a stereo picture of no kind was asked for");
}

Image anaglyph(const Image& left, const Image& right) {
  require_pair(left, right);
  Image out(left.width, left.height, 3);
  for (std::size_t i = 0; i < left.pixels(); ++i) {
    std::array<double, 3> l{};
    std::array<double, 3> r{};
    for (std::size_t c = 0; c < 3; ++c) {
      l[c] = linear_from_srgb(left.data[3 * i + c]);
      r[c] = linear_from_srgb(right.data[3 * i + c]);
    }
    for (std::size_t c = 0; c < 3; ++c) {
      double v = 0;
      for (std::size_t k = 0; k < 3; ++k) v += kLeft[c][k] * l[k] + kRight[c][k] * r[k];
      out.data[3 * i + c] = srgb_from_linear(v);
    }
  }
  return out;
}

}  // namespace slide
