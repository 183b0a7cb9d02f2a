#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>

#include "render/camera_path.h"

namespace slide {
namespace {

// With r = (x̂, ŷ, 1) the ray of a photo pixel, u = R r and w the inverse depth, a view shows the point at
// f (u.xy + t.xy w) / (u.z + t.z w). Between two inverse depths wa and wb it therefore moves by
//   f (wa - wb) |t.xy u.z - u.xy t.z| / ((u.z + t.z wa)(u.z + t.z wb)),
// a norm of an affine function over two positive affine functions of (x̂, ŷ). Over a box, the numerator is
// largest and each factor of the denominator smallest at a corner, which bounds the quotient from above;
// halving the box with the largest bound until bound and best corner agree gives the maximum (branch and
// bound).
class MotionField {
 public:
  MotionField(const View& view, double inverse_a, double inverse_b)
      : rotation_(view.pose.rotation), translation_(view.pose.translation), a_(inverse_a), b_(inverse_b) {}

  struct Sample {
    double numerator;
    double za;  ///< depth times inverse depth: 1 in the photo
    double zb;
  };
  [[nodiscard]] Sample at(double x, double y) const {
    const glm::dvec3 u = rotation_ * glm::dvec3(x, y, 1.0);
    const glm::dvec2 n = glm::dvec2(translation_) * u.z - glm::dvec2(u) * translation_.z;
    return {std::hypot(n.x, n.y), u.z + translation_.z * a_, u.z + translation_.z * b_};
  }

 private:
  glm::dmat3 rotation_;
  glm::dvec3 translation_;
  double a_;
  double b_;
};

struct Box {
  double x0, y0, x1, y1;
  double bound;  ///< no value inside exceeds it
  bool operator<(const Box& other) const { return bound < other.bound; }
};

/// Sets the box's bound; returns its largest corner value. Both are infinite where the scene comes closer
/// than `smallest` (in units of za, zb).
double evaluate(const MotionField& field, double smallest, Box& box) {
  double numerator = 0.0;
  double za = std::numeric_limits<double>::infinity();
  double zb = za;
  double best = 0.0;
  for (int i = 0; i < 4; ++i) {
    const auto s = field.at((i & 1) != 0 ? box.x1 : box.x0, (i & 2) != 0 ? box.y1 : box.y0);
    numerator = std::max(numerator, s.numerator);
    za = std::min(za, s.za);
    zb = std::min(zb, s.zb);
    best = std::max(best, s.numerator / (s.za * s.zb));
  }
  const bool behind = std::min(za, zb) < smallest;
  box.bound = behind ? std::numeric_limits<double>::infinity() : numerator / (za * zb);
  return behind ? box.bound : best;
}

constexpr double kRelativeGap = 1e-6;
constexpr int kMostBoxes = 100000;

double largest_motion(const MotionField& field, double half_width, double half_height, double smallest) {
  Box whole{-half_width, -half_height, half_width, half_height, 0.0};
  double best = evaluate(field, smallest, whole);
  std::priority_queue<Box> boxes;
  boxes.push(whole);
  for (int i = 0; i < kMostBoxes && boxes.top().bound > best * (1.0 + kRelativeGap); ++i) {
    Box first = boxes.top();
    boxes.pop();
    Box second = first;
    if (first.x1 - first.x0 > first.y1 - first.y0) {
      first.x1 = second.x0 = 0.5 * (first.x0 + first.x1);
    } else {
      first.y1 = second.y0 = 0.5 * (first.y0 + first.y1);
    }
    best = std::max({best, evaluate(field, smallest, first), evaluate(field, smallest, second)});
    boxes.push(first);
    boxes.push(second);
  }
  return std::max(best, boxes.top().bound);
}

/// The largest motion of any view between inverse depths a and b, per unit of inverse depth, in photo pixels.
double largest_over_views(const Camera& camera, const std::vector<View>& views, double a, double b) {
  const double smallest = camera.clip_depth() * std::max(a, b);
  double largest = 0.0;
  for (const View& view : views) {
    const double motion = largest_motion(MotionField(view, a, b), (camera.width - 1) / 2.0 / camera.focal,
                                         (camera.height - 1) / 2.0 / camera.focal, smallest);
    largest = std::max(largest, view.zoom * camera.focal * motion);
  }
  return largest;
}

}  // namespace

double largest_parallax(const Camera& camera, const std::vector<View>& views) {
  const double near = camera.inverse_depth(1.0);
  const double far = camera.inverse_depth(0.0);
  return std::min((near - far) * largest_over_views(camera, views, near, far),
                  std::hypot(camera.width, camera.height));
}

double largest_parallax_rate(const Camera& camera, const std::vector<View>& views) {
  const double near = camera.inverse_depth(1.0);
  const double far = camera.inverse_depth(0.0);
  // Between its ends the derivative is monotone in the inverse depth, so one of the ends has the largest.
  return (near - far) *
         std::max(largest_over_views(camera, views, near, near), largest_over_views(camera, views, far, far));
}

}  // namespace slide
