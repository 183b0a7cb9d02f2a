#include "render/camera.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "runtime/error.h"

namespace slide {

Camera make_camera(int width, int height, double fov, double near_depth, double far_depth) {
  if (!(fov >= 1.0 && fov <= 170.0)) {
    throw Error(ErrorKind::kUsage,
                "the field of view is " + std::to_string(fov) + " degrees, outside 1 to 170");
  }
  if (!(near_depth > 0.0 && far_depth > near_depth && far_depth <= 1e6 * near_depth &&
        std::isfinite(far_depth))) {
    throw Error(ErrorKind::kUsage, "near " + std::to_string(near_depth) + " and far " +
                                       std::to_string(far_depth) +
                                       " are no range of depth: 0 < near < far <= 1000000 near is needed");
  }
  Camera camera;
  camera.width = width;
  camera.height = height;
  camera.focal = width / 2.0 / std::tan(fov * (3.14159265358979323846 / 360.0));
  camera.near_depth = near_depth;
  camera.far_depth = far_depth;
  return camera;
}

glm::dvec3 back_project(const Camera& camera, double x, double y, double disparity) {
  const glm::dvec2 centre = camera.centre();
  const double z = 1.0 / camera.inverse_depth(disparity);
  return {(x - centre.x) / camera.focal * z, (y - centre.y) / camera.focal * z, z};
}

glm::dvec2 project(const Camera& camera, const View& view, const glm::dvec3& point) {
  const glm::dvec3 p = view.pose.rotation * point + view.pose.translation;
  const double scale = view.zoom * camera.focal / p.z;
  return camera.centre() + view.shift + glm::dvec2(p.x, p.y) * scale;
}

double view_scale(const Camera& camera, int out_width, int out_height) {
  return std::max(static_cast<double>(out_width) / camera.width,
                  static_cast<double>(out_height) / camera.height);
}

}  // namespace slide
