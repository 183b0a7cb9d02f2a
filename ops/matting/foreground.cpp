#include "ops/matting/foreground.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "ops/common/elements.h"
#include "ops/matting/foreground_op.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kSmallSide = 32;
constexpr int kStepsOfSmall = 10;
constexpr int kStepsOfLarge = 2;

struct Plane {
  std::int64_t h, w;
  std::vector<double> v;

  Plane(std::int64_t height, std::int64_t width, double value = 0)
      : h(height), w(width), v(static_cast<std::size_t>(h * w), value) {}
  double& at(std::int64_t i, std::int64_t j) { return v[static_cast<std::size_t>(i * w + j)]; }
  [[nodiscard]] double at(std::int64_t i, std::int64_t j) const {
    return v[static_cast<std::size_t>(i * w + j)];
  }
};

/// The plane at another size, by nearest neighbour.
Plane picked(const Plane& x, std::int64_t h, std::int64_t w) {
  Plane y(h, w);
  for (std::int64_t i = 0; i < h; ++i)
    for (std::int64_t j = 0; j < w; ++j) y.at(i, j) = x.at(i * x.h / h, j * x.w / w);
  return y;
}

/// The mean of x where `of` holds for alpha, 0 if it holds nowhere.
template <typename Of>
double mean_where(const Plane& x, const Plane& alpha, Of of) {
  double sum = 0, count = 0;
  for (std::size_t i = 0; i < x.v.size(); ++i)
    if (of(alpha.v[i])) sum += x.v[i], ++count;
  return count == 0 ? 0 : sum / count;
}

/// F and B of one channel.
struct Colours {
  Plane front, behind;
};

/// One step for pixel (i, j), from the colours `x` of all.
std::array<double, 2> improved(const Colours& x, const Plane& image, const Plane& alpha, std::int64_t i,
                               std::int64_t j) {
  const double a = alpha.at(i, j);
  double d = 0, f = 0, b = 0;
  constexpr std::array<std::array<std::int64_t, 2>, 4> kNeighbours{{{-1, 0}, {1, 0}, {0, -1}, {0, 1}}};
  for (const auto& [down, right] : kNeighbours) {
    const std::int64_t u = std::clamp<std::int64_t>(i + down, 0, alpha.h - 1);
    const std::int64_t v = std::clamp<std::int64_t>(j + right, 0, alpha.w - 1);
    const double weight = kSmoothness + std::fabs(a - alpha.at(u, v));
    d += weight;
    f += weight * x.front.at(u, v);
    b += weight * x.behind.at(u, v);
  }
  f /= d;
  b /= d;
  const double r = image.at(i, j) - a * f - (1 - a) * b;
  const double q = a * a + (1 - a) * (1 - a) + d;
  return {std::clamp(f + a * r / q, 0.0, 1.0), std::clamp(b + (1 - a) * r / q, 0.0, 1.0)};
}

Colours estimate(const Plane& image, const Plane& alpha) {
  Colours x{Plane(1, 1, mean_where(image, alpha, [](double a) { return a > kSurelyFront; })),
            Plane(1, 1, mean_where(image, alpha, [](double a) { return a < kSurelyBehind; }))};
  for (const MattingLevel& level : matting_levels(image.h, image.w)) {
    const Plane small_image = picked(image, level.h, level.w);
    const Plane small_alpha = picked(alpha, level.h, level.w);
    x = {picked(x.front, level.h, level.w), picked(x.behind, level.h, level.w)};
    for (int step = 0; step < level.steps; ++step) {
      const Colours before = x;
      for (std::int64_t i = 0; i < level.h; ++i)
        for (std::int64_t j = 0; j < level.w; ++j) {
          const auto [f, b] = improved(before, small_image, small_alpha, i, j);
          x.front.at(i, j) = f;
          x.behind.at(i, j) = b;
        }
    }
  }
  return x;
}

Plane plane_of(const Tensor& t, const Nchw& s, std::int64_t index) {
  Plane p(s.h, s.w);
  std::copy_n(f64(t) + index * s.plane(), s.plane(), p.v.begin());
  return p;
}

}  // namespace

std::vector<MattingLevel> matting_levels(std::int64_t h, std::int64_t w) {
  int last = 0;
  while ((std::int64_t{1} << last) < std::max(h, w)) ++last;
  std::vector<MattingLevel> levels;
  for (int l = 0; l <= last; ++l) {
    const double part = last == 0 ? 1 : static_cast<double>(l) / last;
    const auto side = [&](std::int64_t full) -> std::int64_t {
      return l == last ? full : std::llround(std::pow(static_cast<double>(full), part));
    };
    const std::int64_t height = side(h), width = side(w);
    levels.push_back({height, width, std::max(height, width) <= kSmallSide ? kStepsOfSmall : kStepsOfLarge});
  }
  return levels;
}

Shape ForegroundColoursOp::infer(std::span<const Shape> inputs) const {
  require_input_count("foreground_colours", inputs, 2, 2);
  const Nchw image = nchw(inputs[0]);
  require(inputs[1] == inputs[0].with(1, 1),
          "alpha is " + inputs[1].text() + " for a picture of " + inputs[0].text());
  return inputs[0].with(1, 2 * image.c);
}

void ForegroundColoursOp::reference(std::span<const Tensor> inputs, Tensor& output) const {
  const Nchw s = nchw(inputs[0].shape());
  for_ranges(s.n * s.c, 1, [&](std::int64_t plane, std::int64_t) {
    const std::int64_t n = plane / s.c;
    const Colours x = estimate(plane_of(inputs[0], s, plane), plane_of(inputs[1], s, n));
    std::ranges::copy(x.front.v, f64(output) + (plane + n * s.c) * s.plane());
    std::ranges::copy(x.behind.v, f64(output) + (plane + (n + 1) * s.c) * s.plane());
  });
}

void ForegroundColoursOp::error_scale(std::span<const Tensor> inputs, const Tensor& output,
                                      Tensor& scale) const {
  const std::int64_t count = output.shape().count() / output.shape()[0];
  for (std::int64_t n = 0; n < output.shape()[0]; ++n) {
    double largest = 1;
    for (std::int64_t i = n * count / 2; i < (n + 1) * count / 2; ++i)
      largest = std::max(largest, std::fabs(f64(inputs[0])[i]));
    std::fill_n(f64(scale) + n * count, count, largest);
  }
}

double ForegroundColoursOp::definition_factor(std::span<const Shape> inputs, const Shape& /*output*/) const {
  const Nchw s = nchw(inputs[0]);
  double steps = 0;
  for (const MattingLevel& level : matting_levels(s.h, s.w)) steps += level.steps;
  return 16 + 12 * steps;
}

Value foreground_colours(Value image, Value alpha) {
  return image.graph().add(std::make_shared<ForegroundColoursOp>(), {image, alpha});
}

}  // namespace slide::ops
