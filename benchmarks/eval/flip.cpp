#include "benchmarks/eval/flip.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <glm/vec3.hpp>
#include <numbers>

namespace slide::eval {
namespace {

// Equation and table numbers are those of the paper.
constexpr double kColourExponent = 0.7;   ///< q_c
constexpr double kCutColour = 0.4;        ///< p_c
constexpr double kCutValue = 0.95;        ///< p_t
constexpr double kFeatureWidth = 0.082;   ///< w, degrees
constexpr double kFeatureExponent = 0.5;  ///< q_f

/// One channel's contrast sensitivity: the sum of a·√(π/b)·exp(-π² d² / b), d in degrees (table 1).
struct Sensitivity {
  struct Term {
    double a, b;
  };
  std::array<Term, 2> terms;
};
constexpr std::array<Sensitivity, 3> kSensitivities = {
    {{{{{1, 0.0047}, {0, 1e-5}}}}, {{{{1, 0.0053}, {0, 1e-5}}}}, {{{{34.1, 0.04}, {13.5, 0.025}}}}}};
constexpr double kWidestB = 0.04;

/// Linear sRGB to CIE XYZ for a D65 white, as fractions; the rows.
const glm::dmat3& xyz_from_rgb() {
  static const glm::dmat3 kMatrix =
      glm::transpose(glm::dmat3(10135552.0 / 24577794, 8788810.0 / 24577794, 4435075.0 / 24577794,
                                2613072.0 / 12288897, 8788810.0 / 12288897, 887015.0 / 12288897,
                                1425312.0 / 73733382, 8788810.0 / 73733382, 70074185.0 / 73733382));
  return kMatrix;
}
const glm::dvec3& white() {
  static const glm::dvec3 kWhite = xyz_from_rgb() * glm::dvec3(1.0);
  return kWhite;
}

double linear(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }

/// Y, Cx, Cz: CIELAB without the cube root, so that filtering it is filtering light.
glm::dvec3 opponent(const glm::dvec3& rgb) {
  const glm::dvec3 t = xyz_from_rgb() * rgb / white();
  return {116 * t.y - 16, 500 * (t.x - t.y), 200 * (t.y - t.z)};
}
glm::dvec3 rgb_from_opponent(const glm::dvec3& o) {
  const double y = (o.x + 16) / 116;
  static const glm::dmat3 kInverse = glm::inverse(xyz_from_rgb());
  return kInverse * (glm::dvec3(y + o.y / 500, y, y - o.z / 200) * white());
}

/// CIELAB, chroma scaled by 0.01·L (Hunt).
glm::dvec3 hunt_lab(const glm::dvec3& rgb) {
  const glm::dvec3 t = xyz_from_rgb() * rgb / white();
  const auto root = [](double v) {
    constexpr double kDelta = 6.0 / 29;
    return v > kDelta * kDelta * kDelta ? std::cbrt(v) : v / (3 * kDelta * kDelta) + 4.0 / 29;
  };
  const double x = root(t.x);
  const double y = root(t.y);
  const double z = root(t.z);
  const double lightness = 116 * y - 16;
  return {lightness, 0.01 * lightness * 500 * (x - y), 0.01 * lightness * 200 * (y - z)};
}

double hyab(const glm::dvec3& a, const glm::dvec3& b) {
  return std::fabs(a.x - b.x) + std::hypot(a.y - b.y, a.z - b.z);
}

using Planes = std::array<Plane, 3>;

Planes opponent_planes(const Image& image) {
  Planes out;
  out.fill(Plane(image.width, image.height));
  for (std::size_t i = 0; i < image.pixels(); ++i) {
    glm::dvec3 rgb;
    for (int c = 0; c < 3; ++c)
      rgb[c] =
          linear(std::clamp(static_cast<double>(image.data[3 * i + static_cast<std::size_t>(c)]), 0.0, 1.0));
    const glm::dvec3 o = opponent(rgb);
    for (int c = 0; c < 3; ++c) out[static_cast<std::size_t>(c)].data[i] = o[c];
  }
  return out;
}

/// A channel as the eye resolves it: both terms are separable.
Plane seen(const Plane& p, const Sensitivity& sensitivity, double pixels_per_degree) {
  const double pi = std::numbers::pi;
  const int radius = static_cast<int>(std::ceil(3 * std::sqrt(kWidestB / (2 * pi * pi)) * pixels_per_degree));
  Plane out(p.width, p.height);
  double weight = 0;
  for (const Sensitivity::Term& term : sensitivity.terms) {
    if (term.a == 0) continue;
    std::vector<double> taps;
    double sum = 0;
    for (int i = -radius; i <= radius; ++i) {
      const double d = i / pixels_per_degree;
      taps.push_back(std::exp(-pi * pi * d * d / term.b));
      sum += taps.back();
    }
    const double factor = term.a * std::sqrt(pi / term.b);
    weight += factor * sum * sum;
    out = combined(out, filtered(p, taps, taps, Border::kRepeated),
                   [factor](double x, double y) { return x + factor * y; });
  }
  for (double& v : out.data) v /= weight;
  return out;
}

std::vector<glm::dvec3> seen_colours(const Planes& planes, double pixels_per_degree) {
  Planes filtered_planes;
  for (std::size_t c = 0; c < 3; ++c)
    filtered_planes[c] = seen(planes[c], kSensitivities[c], pixels_per_degree);
  std::vector<glm::dvec3> out;
  for (std::size_t i = 0; i < planes[0].data.size(); ++i) {
    const glm::dvec3 rgb = rgb_from_opponent(
        {filtered_planes[0].data[i], filtered_planes[1].data[i], filtered_planes[2].data[i]});
    out.push_back(hunt_lab(glm::clamp(rgb, 0.0, 1.0)));
  }
  return out;
}

/// HyAB distances compressed into [0, 1].
double colour_error(const glm::dvec3& a, const glm::dvec3& b) {
  static const double kLargest = std::pow(hyab(hunt_lab({0, 1, 0}), hunt_lab({0, 0, 1})), kColourExponent);
  const double e = std::pow(hyab(a, b), kColourExponent);
  const double cut = kCutColour * kLargest;
  return e < cut ? kCutValue / cut * e : kCutValue + (e - cut) / (kLargest - cut) * (1 - kCutValue);
}

/// Filters along a line, positive taps summing to 1 and negative ones to -1.
struct FeatureTaps {
  std::vector<double> smooth, edge, point;
};
void normalise(std::vector<double>& taps) {
  double positive = 0;
  double negative = 0;
  for (const double t : taps) (t > 0 ? positive : negative) += std::fabs(t);
  for (double& t : taps) t /= t > 0 ? positive : negative > 0 ? negative : 1;
}
FeatureTaps feature_taps(double pixels_per_degree) {
  const double sd = 0.5 * kFeatureWidth * pixels_per_degree;
  const int radius = static_cast<int>(std::ceil(3 * sd));
  FeatureTaps out;
  for (int i = -radius; i <= radius; ++i) {
    const double g = std::exp(-i * i / (2 * sd * sd));
    out.smooth.push_back(g);
    out.edge.push_back(-i * g);
    out.point.push_back((i * i / (sd * sd) - 1) * g);
  }
  normalise(out.smooth);
  normalise(out.edge);
  normalise(out.point);
  return out;
}

/// The filter along rows and along columns, as one magnitude.
Plane magnitude(const Plane& y, const std::vector<double>& taps, const std::vector<double>& smooth) {
  return combined(filtered(y, taps, smooth, Border::kRepeated), filtered(y, smooth, taps, Border::kRepeated),
                  [](double h, double v) { return std::hypot(h, v); });
}

/// Differences of edges and points, the larger one of each pixel to the power q_f.
Plane feature_error(Plane a, Plane b, double pixels_per_degree) {
  for (Plane* p : {&a, &b})
    for (double& v : p->data) v = (v + 16) / 116;
  const FeatureTaps taps = feature_taps(pixels_per_degree);
  const auto difference = [&](const std::vector<double>& t) {
    return combined(magnitude(a, t, taps.smooth), magnitude(b, t, taps.smooth),
                    [](double x, double y) { return std::fabs(x - y); });
  };
  return combined(difference(taps.edge), difference(taps.point), [](double edge, double point) {
    return std::pow(std::max(edge, point) / std::numbers::sqrt2, kFeatureExponent);
  });
}

}  // namespace

Plane flip_map(const Image& a, const Image& b, double pixels_per_degree) {
  const Planes x = opponent_planes(a);
  const Planes y = opponent_planes(b);
  const std::vector<glm::dvec3> colours_a = seen_colours(x, pixels_per_degree);
  const std::vector<glm::dvec3> colours_b = seen_colours(y, pixels_per_degree);
  Plane out = feature_error(x[0], y[0], pixels_per_degree);
  for (std::size_t i = 0; i < out.data.size(); ++i)
    out.data[i] = std::pow(colour_error(colours_a[i], colours_b[i]), 1 - out.data[i]);
  return out;
}

double flip(const Image& a, const Image& b, const Image& mask) {
  return weighted(flip_map(a, b), plane(mask)).mean;
}

}  // namespace slide::eval
