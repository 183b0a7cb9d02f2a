#include "render/camera_path.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>

#include "runtime/error.h"

namespace slide {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// A camera standing at `centre`, looking straight ahead, with the plane of inverse depth `still` standing
/// still.
View sideways_view(const Camera& camera, const glm::dvec3& centre, double still) {
  View view;
  view.pose.translation = -centre;
  view.shift = glm::dvec2(centre.x, centre.y) * (camera.focal * still);
  return view;
}

/// A camera moved forward by `distance`; with a dolly zoom the plane of inverse depth `still` keeps its size.
View forward_view(double distance, bool dolly, double still) {
  View view;
  view.pose.translation = {0.0, 0.0, -distance};
  view.zoom = dolly ? 1.0 - distance * still : 1.0;
  return view;
}

/// The largest distance at which P of the view is at most `parallax`, found by bisection: P grows with the
/// distance.
double forward_amplitude(const Camera& camera, double parallax, bool dolly, double still) {
  const auto parallax_at = [&](double distance) {
    return largest_parallax(camera, {forward_view(distance, dolly, still)});
  };
  double low = 0.0;
  double high = 0.95 * camera.near_depth;
  if (parallax_at(high) < parallax) {
    throw Error(ErrorKind::kUsage,
                "a parallax of " + std::to_string(parallax) + " pixels would take this zoom into the scene",
                "choose a smaller parallax");
  }
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (parallax_at(middle) <= parallax ? low : high) = middle;
  }
  return low;
}

void check_options(const PathOptions& options) {
  if (!(options.parallax_percent >= 0.0 && options.parallax_percent <= 50.0)) {
    throw Error(ErrorKind::kUsage,
                "the parallax is " + std::to_string(options.parallax_percent) + " percent, outside 0 to 50");
  }
  if (!(options.focus >= 0.0 && options.focus <= 1.0)) {
    throw Error(ErrorKind::kUsage,
                "the focus is disparity " + std::to_string(options.focus) + ", outside 0 to 1");
  }
  if (options.frames < 1 || options.frames > 100000) {
    throw Error(ErrorKind::kUsage, std::to_string(options.frames) + " frames asked for, outside 1 to 100000");
  }
}

}  // namespace

double parallax_pixels(double percent, int width, int height) {
  return percent / 100.0 * std::min(width, 2 * height);
}

PathKind path_kind(const std::string& name) {
  if (name == "circle") return PathKind::kCircle;
  if (name == "swing") return PathKind::kSwing;
  if (name == "zoom") return PathKind::kZoom;
  if (name == "dolly-zoom") return PathKind::kDollyZoom;
  throw Error(ErrorKind::kUsage, "there is no camera path \"" + name + "\"",
              "choose circle, swing, zoom, dolly-zoom or a JSON file of poses");
}

std::vector<View> make_path(const Camera& camera, const PathOptions& options) {
  check_options(options);
  const double parallax = parallax_pixels(options.parallax_percent, camera.width, camera.height);
  const double still = camera.inverse_depth(options.focus);
  const bool dolly = options.kind == PathKind::kDollyZoom;
  const bool forward = dolly || options.kind == PathKind::kZoom;
  const double inverse_range = camera.inverse_depth(1.0) - camera.inverse_depth(0.0);
  const double amplitude =
      forward ? forward_amplitude(camera, parallax, dolly, still) : parallax / (camera.focal * inverse_range);
  std::vector<View> views;
  views.reserve(static_cast<std::size_t>(options.frames));
  for (int i = 0; i < options.frames; ++i) {
    const double angle = 2.0 * kPi * i / options.frames;
    if (forward) {
      views.push_back(forward_view(amplitude * (1.0 - std::cos(angle)) / 2.0, dolly, still));
    } else if (options.kind == PathKind::kSwing) {
      views.push_back(sideways_view(camera, {amplitude * std::sin(angle), 0.0, 0.0}, still));
    } else {
      const glm::dvec3 centre{amplitude * std::cos(angle), amplitude * std::sin(angle), 0.0};
      views.push_back(sideways_view(camera, centre, still));
    }
  }
  return views;
}

std::vector<Eyes> eyes_of(const Camera& camera, const std::vector<View>& views, double parallax_percent,
                          double focus) {
  // Of a swing in four frames the second is at its right end.
  const View right = make_path(
      camera,
      {.kind = PathKind::kSwing, .parallax_percent = parallax_percent, .focus = focus, .frames = 4})[1];
  const auto moved = [&](View view, double side) {
    view.pose.translation += side * right.pose.translation;
    view.shift += side * view.zoom * right.shift;
    return view;
  };
  std::vector<Eyes> eyes;
  eyes.reserve(views.size());
  for (const View& view : views) eyes.push_back({moved(view, -1), moved(view, 1)});
  return eyes;
}

}  // namespace slide
