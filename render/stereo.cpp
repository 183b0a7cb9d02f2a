#include "render/stereo.h"

#include <algorithm>
#include <array>
#include <cmath>

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
