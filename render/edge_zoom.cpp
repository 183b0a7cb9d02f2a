#include "render/edge_zoom.h"

#include <algorithm>
#include <cmath>

namespace slide {
namespace {

constexpr double kLargestZoom = 2;
constexpr int kSamples = 32;  ///< places along each side of the photo

/// Projection is monotonic in disparity along the ray of a pixel, so the ends of [0, 1] bound all in between.
constexpr double kDisparities[] = {0, 1};

/// The factor that brings a point seen at `seen` (from the centre, outwards positive) out to `half`.
double needed(double seen, double half) { return seen > half / kLargestZoom ? half / seen : kLargestZoom; }

/// Whether a photo that stands at one depth is seen at a place of a view, `at` from the centre in pixels.
bool is_covered(const Camera& camera, const View& view, double depth, glm::dvec2 at) {
  const glm::dmat3 back = glm::transpose(view.pose.rotation);
  const glm::dvec3 eye = -(back * view.pose.translation);
  const glm::dvec3 ray = back * glm::dvec3((at - view.shift) / (view.zoom * camera.focal), 1.0);
  const double along = (depth - eye.z) / ray.z;
  const glm::dvec2 place = glm::dvec2(eye + along * ray) * (camera.focal / depth);
  return along > 0 && std::abs(place.x) <= camera.width / 2.0 && std::abs(place.y) <= camera.height / 2.0;
}

/// The part of a view's frame that a photo at one depth covers.
double coverage(const Camera& camera, const View& view, double depth) {
  int covered = 0;
  for (int i = 0; i < kSamples * kSamples; ++i) {
    const int column = i % kSamples;
    const int row = i / kSamples;
    const glm::dvec2 part((column + 0.5) / kSamples - 0.5, (row + 0.5) / kSamples - 0.5);
    covered += is_covered(camera, view, depth, part * glm::dvec2(camera.width, camera.height)) ? 1 : 0;
  }
  return static_cast<double>(covered) / (kSamples * kSamples);
}

}  // namespace

double edge_zoom(const Camera& camera, const std::vector<View>& views) {
  const double half_width = camera.width / 2.0;
  const double half_height = camera.height / 2.0;
  const glm::dvec2 centre = camera.centre();
  double zoom = 1;
  const auto consider = [&](const View& view, glm::dvec2 at, int axis, double side, double half) {
    for (const double disparity : kDisparities) {
      const glm::dvec3 point = back_project(camera, centre.x + at.x, centre.y + at.y, disparity);
      const glm::dvec3 seen = view.pose.rotation * point + view.pose.translation;
      if (seen.z <= camera.clip_depth()) continue;
      const glm::dvec2 place = project(camera, view, point) - centre;
      zoom = std::max(zoom, needed(side * place[axis], half));
    }
  };
  for (const View& view : views)
    for (int i = 0; i <= kSamples; ++i) {
      const double t = 2.0 * i / kSamples - 1;
      for (const double side : {-1.0, 1.0}) {
        consider(view, {side * half_width, t * half_height}, 0, side, half_width);
        consider(view, {t * half_width, side * half_height}, 1, side, half_height);
      }
    }
  return zoom;
}

double least_coverage(const Camera& camera, const std::vector<View>& views) {
  double least = 1;
  for (const View& view : views)
    for (const double disparity : kDisparities)
      least = std::min(least, coverage(camera, view, 1.0 / camera.inverse_depth(disparity)));
  return least;
}

std::vector<View> without_edges(const Camera& camera, std::vector<View> views) {
  const double zoom = edge_zoom(camera, views);
  for (View& view : views) {
    view.zoom *= zoom;
    view.shift *= zoom;
  }
  return views;
}

}  // namespace slide
