#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "render/camera.h"

namespace slide {

/// How the camera moves. All but the pose file are closed: the frame after the last is the first.
/// With s = frame / frames, a = the amplitude that --parallax asks for, and the camera's centre at:
enum class PathKind {
  kCircle,     ///< a (cos 2πs, sin 2πs, 0): the paper's studies
  kSwing,      ///< a (sin 2πs, 0, 0)
  kZoom,       ///< a (0, 0, (1 - cos 2πs)/2): forward and back; only the picture's centre stands still
  kDollyZoom,  ///< as kZoom, the focal length following so that the focused disparity stands still
};

struct PathOptions {
  PathKind kind = PathKind::kCircle;
  /// The amplitude, as the largest parallax P: see parallax_pixels(). 0 to 50.
  double parallax_percent = 4.0;
  /// The disparity that stands still (circle, swing, dolly zoom), 0 to 1.
  double focus = 0.5;
  int frames = 60;
};

/// A parallax given in percent: of the photo's width, or of twice its height where it is wider than that. What
/// a panorama shows is as large as its height; the same part of its width would tear it apart.
[[nodiscard]] double parallax_pixels(double percent, int width, int height);

/// The names used on command lines: circle, swing, zoom, dolly-zoom.
/// @throws Error(kUsage) for another name
[[nodiscard]] PathKind path_kind(const std::string& name);

/// The views of a path, one per frame.
/// @throws Error(kUsage) for options out of range, or when a zoom would have to run into the scene to reach
/// the parallax
[[nodiscard]] std::vector<View> make_path(const Camera& camera, const PathOptions& options);

/// Where the two eyes of somebody who looks along a view are.
struct Eyes {
  View left, right;
};

/// The eyes of each view: the two ends of a swing of `parallax_percent` about it, along its own x axis. The
/// disparity `focus`, as far as it stands still in the views, does so in both eyes.
/// @throws Error(kUsage) for a parallax or focus out of range
[[nodiscard]] std::vector<Eyes> eyes_of(const Camera& camera, const std::vector<View>& views,
                                        double parallax_percent, double focus);

/// The largest parallax P of a set of views: the most that a pixel of disparity 1 moves against one of
/// disparity 0 at the same place, between the photo and any of the views, over all places between the photo's
/// outermost pixel centres, in pixels of the photo. It is an upper bound that exceeds the true maximum by at
/// most 1e-6 of it; exact where no view is rotated. Where a view brings the scene behind its clip plane, and
/// at most, it is the photo's diagonal.
[[nodiscard]] double largest_parallax(const Camera& camera, const std::vector<View>& views);

/// The most pixels that a point of the photo moves in any view per unit of disparity, over all places and
/// disparities: an error of e in disparity displaces nothing by more than e times this. At least
/// largest_parallax(), and equal to it where the camera moves only sideways. Infinite where a view brings the
/// scene behind its clip plane.
[[nodiscard]] double largest_parallax_rate(const Camera& camera, const std::vector<View>& views);

/// Reads a camera path from a JSON file:
///
///     {"frames": [{"rotation": [[1,0,0],[0,1,0],[0,0,1]], "translation": [0,0,0], "zoom": 1, "shift": [0,0]}, ...]}
///
/// Per frame, Xcam = rotation · X + translation takes scene points into that frame's camera; `rotation` is
/// given by rows; x is to the right, y down, z forward; the photo's own camera is the identity; a scene unit
/// is z_near, the depth of disparity 1, when --near is 1. `zoom` (focal length over the photo's; default 1)
/// and `shift` (of the principal point, pixels of the photo; default 0) may be left out, and so may a
/// rotation or translation that does nothing. A rotation may be off by rounding, up to 1e-3 in any entry of
/// R·Rᵀ, and is made orthonormal.
/// @throws Error(kBadInput) naming the file and the place for whatever is wrong: syntax, unknown keys, shapes,
///   numbers that are not finite or beyond 1e6, matrices that are no rotations, no frames, more than 100000
///   frames, more than 64 MiB
[[nodiscard]] std::vector<View> read_pose_file(const std::string& path);

/// As read_pose_file, from text; `name` stands for the file in messages.
[[nodiscard]] std::vector<View> parse_poses(std::string_view text, const std::string& name);

}  // namespace slide
