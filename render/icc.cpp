#include "render/icc.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string_view>

#include "runtime/threads.h"

namespace slide {
namespace {

using Bytes = std::span<const std::uint8_t>;
using Curve = std::vector<double>;
using Matrix = std::array<double, 9>;

constexpr std::size_t kCurvePoints = 1024;

/// Linear sRGB of XYZ under D50, the white point of profiles: the inverse of sRGB's primaries (IEC 61966-2-1)
/// adapted by Bradford's transform, as sRGB's own profile has them.
constexpr Matrix kSrgbFromXyz = {3.13411216, -1.61739244, -0.49063342, -0.97878728, 1.91627957,
                                 0.03345472, 0.07198303,  -0.22898585, 1.40538513};

std::uint32_t u32(Bytes b, std::size_t at) {
  return static_cast<std::uint32_t>(b[at]) << 24U | static_cast<std::uint32_t>(b[at + 1]) << 16U |
         static_cast<std::uint32_t>(b[at + 2]) << 8U | b[at + 3];
}

double u16(Bytes b, std::size_t at) { return b[at] * 256.0 + b[at + 1]; }

/// A fixed-point number of 16 and 16 bits.
double s15_16(Bytes b, std::size_t at) { return static_cast<std::int32_t>(u32(b, at)) / 65536.0; }

bool has(Bytes b, std::size_t at, std::string_view text) {
  return b.size() >= at + text.size() &&
         std::equal(text.begin(), text.end(), b.begin() + static_cast<std::ptrdiff_t>(at));
}

/// The data of a tag; empty where there is none.
Bytes tag_of(Bytes profile, std::string_view signature) {
  constexpr std::size_t kTable = 128;
  constexpr std::uint32_t kMostTags = 1000;
  const std::uint32_t count = std::min(u32(profile, kTable), kMostTags);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t at = kTable + 4 + 12 * i;
    if (at + 12 > profile.size()) return {};
    if (!has(profile, at, signature)) continue;
    const std::size_t offset = u32(profile, at + 4);
    const std::size_t size = u32(profile, at + 8);
    if (offset > profile.size() || size > profile.size() - offset) return {};
    return profile.subspan(offset, size);
  }
  return {};
}

template <typename Function>
Curve sampled(const Function& function) {
  Curve curve(kCurvePoints);
  for (std::size_t i = 0; i < curve.size(); ++i)
    curve[i] = function(static_cast<double>(i) / static_cast<double>(kCurvePoints - 1));
  return curve;
}

/// curveType: a table, one exponent, or nothing for linear values.
Curve table_curve(Bytes tag) {
  if (tag.size() < 12) return {};
  const std::size_t count = u32(tag, 8);
  if (count == 0) return {0, 1};
  if (count > (tag.size() - 12) / 2) return {};
  if (count == 1) return sampled([g = u16(tag, 12) / 256](double v) { return std::pow(v, g); });
  Curve curve(count);
  for (std::size_t i = 0; i < count; ++i) curve[i] = u16(tag, 12 + 2 * i) / 65535;
  return curve;
}

/// parametricCurveType: v >= d ? (a·v + b)^g + e : c·v + f, of which each type gives a part.
Curve parametric_curve(Bytes tag) {
  constexpr std::array<std::size_t, 5> kParameters = {1, 3, 4, 5, 7};
  if (tag.size() < 12) return {};
  const auto type = static_cast<std::size_t>(u16(tag, 8));
  if (type >= kParameters.size() || tag.size() < 12 + 4 * kParameters[type]) return {};
  std::array<double, 7> p{};
  for (std::size_t i = 0; i < kParameters[type]; ++i) p[i] = s15_16(tag, 12 + 4 * i);
  const double g = p[0];
  const double a = type == 0 ? 1 : p[1];
  const double b = p[2];
  const bool flat_start = type == 1 || type == 2;  // below -b/a the curve is constant
  if (flat_start && a == 0) return {};
  const double c = flat_start ? 0 : p[3];
  const double d = flat_start ? -b / a : p[4];
  const double e = type == 2 ? p[3] : p[5];
  const double f = type == 2 ? p[3] : p[6];
  return sampled([=](double v) { return v >= d ? std::pow(std::max(0.0, a * v + b), g) + e : c * v + f; });
}

Curve curve_of(Bytes tag) {
  Curve curve;
  if (has(tag, 0, "curv")) curve = table_curve(tag);
  if (has(tag, 0, "para")) curve = parametric_curve(tag);
  const bool finite = std::all_of(curve.begin(), curve.end(), [](double v) { return std::isfinite(v); });
  return finite ? curve : Curve{};
}

double at(const Curve& curve, double value) {
  const double place = std::clamp(value, 0.0, 1.0) * static_cast<double>(curve.size() - 1);
  const auto i = std::min(static_cast<std::size_t>(place), curve.size() - 2);
  const double part = place - static_cast<double>(i);
  return (1 - part) * curve[i] + part * curve[i + 1];
}

/// Whether a profile would move no value by as much as half of 1/255.
bool is_srgb(const ColourProfile& profile) {
  constexpr int kSteps = 64;
  const Matrix identity = ColourProfile{}.matrix;
  for (std::size_t i = 0; i < identity.size(); ++i)
    if (std::abs(profile.matrix[i] - identity[i]) > 2e-3) return false;
  for (const Curve& curve : profile.curves)
    for (int i = 0; i <= kSteps; ++i) {
      const double v = static_cast<double>(i) / kSteps;
      const auto seen = static_cast<double>(srgb_from_linear(static_cast<float>(at(curve, v))));
      if (std::abs(seen - v) > 0.4 / 255) return false;
    }
  return true;
}

/// The matrix from the profile's primaries to sRGB's.
std::optional<Matrix> matrix_of(Bytes profile) {
  Matrix result{};
  std::size_t column = 0;
  for (const char* primary : {"rXYZ", "gXYZ", "bXYZ"}) {
    const Bytes tag = tag_of(profile, primary);
    if (tag.size() < 20 || !has(tag, 0, "XYZ ")) return std::nullopt;
    for (std::size_t row = 0; row < 3; ++row)
      for (std::size_t k = 0; k < 3; ++k)
        result[3 * row + column] += kSrgbFromXyz[3 * row + k] * s15_16(tag, 8 + 4 * k);
    ++column;
  }
  return result;
}

/// srgb_from_linear() by a table: linear between points that lie densely where the curve is steep.
class SrgbTable {
 public:
  SrgbTable() : values_(kPoints + 1) {
    for (std::size_t i = 0; i <= kPoints; ++i) {
      const double root = static_cast<double>(i) / kPoints;
      values_[i] = srgb_from_linear(static_cast<float>(root * root));
    }
  }
  [[nodiscard]] float operator()(double linear) const {
    const double place = std::sqrt(std::clamp(linear, 0.0, 1.0)) * kPoints;
    const auto i = std::min(static_cast<std::size_t>(place), kPoints - 1);
    const auto part = static_cast<float>(place - static_cast<double>(i));
    return (1 - part) * values_[i] + part * values_[i + 1];
  }

 private:
  static constexpr std::size_t kPoints = 4096;
  std::vector<float> values_;
};

}  // namespace

float srgb_from_linear(float linear) noexcept {
  const float x = linear > 0 ? std::min(linear, 1.0F) : 0.0F;
  return x <= 0.0031308F ? 12.92F * x : 1.055F * std::pow(x, 1 / 2.4F) - 0.055F;
}

std::optional<ColourProfile> read_icc_profile(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kHeader = 132;  // with the number of tags
  if (bytes.size() < kHeader || !has(bytes, 36, "acsp") || !has(bytes, 20, "XYZ ")) return std::nullopt;
  ColourProfile profile;
  const bool grey = has(bytes, 16, "GRAY");
  if (!grey && !has(bytes, 16, "RGB ")) return std::nullopt;
  if (!grey) {
    const std::optional<Matrix> matrix = matrix_of(bytes);
    if (!matrix) return std::nullopt;
    profile.matrix = *matrix;
  }
  const std::vector<const char*> names = grey ? std::vector{"kTRC"} : std::vector{"rTRC", "gTRC", "bTRC"};
  for (const char* name : names) {
    profile.curves.push_back(curve_of(tag_of(bytes, name)));
    if (profile.curves.back().size() < 2) return std::nullopt;
  }
  if (is_srgb(profile)) return std::nullopt;
  return profile;
}

std::optional<ColourProfile> gamma_profile(double exponent) {
  constexpr double kUsual = 1 / 2.2;
  if (!(exponent > 0.01 && exponent < 100) || std::abs(exponent / kUsual - 1) < 0.01) return std::nullopt;
  const Curve curve = sampled([=](double v) { return std::pow(v, 1 / exponent); });
  return ColourProfile{.curves = {curve, curve, curve}};
}

void apply_profile(const ColourProfile& profile, Image& image) {
  const std::size_t colours = image.channels > 2 ? 3 : 1;
  if (profile.curves.size() < colours) return;
  const bool grey = colours == 1;
  const SrgbTable encode;
  const Matrix& m = profile.matrix;
  parallel_for(image.height, [&](std::int64_t y) {
    float* pixel = image.row(static_cast<int>(y));
    for (int x = 0; x < image.width; ++x, pixel += image.channels) {
      std::array<double, 3> linear{};
      for (std::size_t c = 0; c < colours; ++c)
        linear[c] = at(profile.curves[c], static_cast<double>(pixel[c]));
      if (grey) {
        pixel[0] = encode(linear[0]);
        continue;
      }
      for (std::size_t c = 0; c < 3; ++c)
        pixel[c] = encode(m[3 * c] * linear[0] + m[3 * c + 1] * linear[1] + m[3 * c + 2] * linear[2]);
    }
  });
}

}  // namespace slide
