#pragma once

#include <glm/mat3x3.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

namespace slide {

/// A rigid motion of the scene into a camera: Xcam = rotation · X + translation, in scene units.
/// Axes: x to the right, y down, z forward, as OpenCV has them.
struct RigidTransform {
  glm::dmat3 rotation{1.0};
  glm::dvec3 translation{0.0};
};

/// The horizontal field of view taken where a photo does not tell its own, in degrees (docs/method.md, section 1).
inline constexpr double kDefaultFov = 53.13;

/// The camera that took the photo: a pinhole with its principal point at the image's centre, ((W-1)/2,
/// (H-1)/2) with pixel centres at integers, and the range of depth that disparity [0, 1] stands for.
struct Camera {
  int width = 0;            ///< of the photo, pixels
  int height = 0;           ///< of the photo, pixels
  double focal = 0.0;       ///< pixels
  double near_depth = 1.0;  ///< depth of disparity 1, scene units
  double far_depth = 10.0;  ///< depth of disparity 0, scene units

  [[nodiscard]] glm::dvec2 centre() const { return {(width - 1) / 2.0, (height - 1) / 2.0}; }
  /// 1/z = D (1/near - 1/far) + 1/far.
  [[nodiscard]] double inverse_depth(double disparity) const {
    return disparity * (1.0 / near_depth - 1.0 / far_depth) + 1.0 / far_depth;
  }
  /// Depth below which a view clips: 1/100 of the nearest depth of the scene.
  [[nodiscard]] double clip_depth() const { return near_depth / 100.0; }
};

/// The camera of a width × height photo.
/// @param fov  horizontal field of view in degrees: focal = W/2 / tan(fov/2)
/// @throws Error(kUsage) unless 1 <= fov <= 170, 0 < near < far and both are finite, far <= 1e6 near
[[nodiscard]] Camera make_camera(int width, int height, double fov = kDefaultFov, double near_depth = 1.0,
                                 double far_depth = 10.0);

/// One view of the scene. Everything is in pixels of the photo, whatever size the view is drawn at:
/// a point X appears at centre + shift + zoom · focal · (Xcam.x, Xcam.y) / Xcam.z.
/// A shift that undoes the motion of one disparity is the off-axis projection of stereo cameras: that plane
/// then stands still everywhere in the picture, which no rotation achieves.
struct View {
  RigidTransform pose;
  double zoom = 1.0;      ///< focal length of the view over that of the photo
  glm::dvec2 shift{0.0};  ///< of the principal point
};

/// The point that pixel (x, y) of the photo shows at a disparity.
[[nodiscard]] glm::dvec3 back_project(const Camera& camera, double x, double y, double disparity);

/// Where a view shows a point, in photo pixels. Xcam.z must be positive.
[[nodiscard]] glm::dvec2 project(const Camera& camera, const View& view, const glm::dvec3& point);

/// From pixels of the photo to pixels of a view drawn at out_width × out_height: x_out = (x - centre) · scale
/// + centre_out. The picture fills the view: what exceeds it, where the shapes differ, is cropped on both
/// sides alike.
[[nodiscard]] double view_scale(const Camera& camera, int out_width, int out_height);

}  // namespace slide
