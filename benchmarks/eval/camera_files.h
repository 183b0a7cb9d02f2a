#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "render/camera.h"

namespace slide::eval {

/// A camera that took a picture: a pinhole as parts of the picture's width and height, measured from its
/// upper left corner, so that it holds at any size; a point X of the world lies at pose.rotation·X +
/// pose.translation, x to the right, y down, z forward.
struct PosedCamera {
  double focal_x, focal_y, centre_x, centre_y;
  RigidTransform pose;
};

/// Cameras by the name of the picture that each took.
using PosedCameras = std::map<std::string, PosedCamera>;

/// {"cameras": [{"file": NAME, "w": W, "h": H, "fx": ., "fy": ., "cx": ., "cy": ., "R": [[...], [...], [...]],
/// "C": [...]}, ...]}: intrinsics in pixels of a W×H picture whose pixel centres are integers, R by rows, and
/// the camera's centre C, or "t" = -R·C instead. Other keys are left alone.
/// @param name  the file, for messages, as below
/// @throws Error(kBadInput) naming the file and the place: syntax, what is missing, numbers that are not
///   finite, focal lengths that are not positive, matrices that are no rotations (to 1e-3); as below
[[nodiscard]] PosedCameras parse_json_cameras(std::string_view text, const std::string& name);

/// A point of the world that was seen, and in which pictures, at which pixel (from the corner of the first).
struct SeenPoint {
  double x, y;
  std::int64_t point;
};

/// COLMAP's text model: cameras.txt and images.txt. Cameras with lens distortion are refused.
struct ColmapModel {
  PosedCameras cameras;
  /// What each picture shows, as parts of its width and height from the upper left corner.
  std::map<std::string, std::vector<SeenPoint>> seen;
};
[[nodiscard]] ColmapModel parse_colmap(std::string_view cameras, std::string_view images,
                                       const std::string& folder);

/// COLMAP's points3D.txt: where each point lies in the world.
[[nodiscard]] std::map<std::int64_t, glm::dvec3> parse_colmap_points(std::string_view text,
                                                                     const std::string& name);

/// A camera file of RealEstate10K (Zhou et al. 2018): after the video's address, a line a frame with its
/// timestamp (the name here), focal lengths and centre as parts of width and height, two zeros, and the 3×4
/// matrix [R | t] by rows.
[[nodiscard]] PosedCameras parse_realestate10k(std::string_view text, const std::string& name);

/// The camera of one of the pictures. @throws Error(kBadInput) naming the file if it has none of that name
[[nodiscard]] const PosedCamera& camera_of(const PosedCameras& cameras, const std::string& picture,
                                           const std::string& file);

}  // namespace slide::eval
