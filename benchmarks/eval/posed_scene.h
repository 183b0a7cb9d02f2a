#pragma once

#include <optional>
#include <string>
#include <vector>

#include "benchmarks/eval/camera_files.h"
#include "render/camera.h"
#include "render/image.h"

namespace slide::eval {

/// A known inverse depth at a pixel of the source.
struct KnownDepth {
  int x, y;
  double inverse;
};

/// Pictures of a place that stands still, with the cameras that took them.
struct PosedScene {
  std::string name;  ///< of its folder
  Image source;      ///< H×W×3, [0, 1]
  PosedCamera camera;
  struct Target {
    std::string name;
    Image picture;  ///< of the source's size
    PosedCamera camera;
  };
  std::vector<Target> targets;
  Image depth;                    ///< H×W×1, scene units, 0 where it is unknown; may be empty
  std::vector<KnownDepth> known;  ///< from the depth map or COLMAP's points; may be empty
  struct Range {
    double near, far;
  };
  std::optional<Range> range;  ///< of the source's depths, where scene.json gives it
};

/// Reads a folder with scene.json:
///
///     {"kind": "posed", "source": PICTURE, "targets": [PICTURE, ...], "images": FOLDER,
///      "cameras": FILE | "colmap": FOLDER | "realestate10k": FILE,
///      "depth": MAP, "depth_unit": UNIT, "near": Z, "far": Z}
///
/// Paths start at the folder. The cameras are one of those of camera_files.h; of RealEstate10K a picture's
/// name without its extension is the timestamp. The rest may be left out: where the pictures lie (the folder),
/// the source's depth (as read_map() gives it, a PNG's stored integers times depth_unit; 0 is unknown), the
/// range of its depths. With COLMAP's model, points3D.txt in its folder gives depths where its points are seen.
/// @throws Error(kBadInput) naming the file for whatever is missing or does not fit together
[[nodiscard]] PosedScene read_posed_scene(const std::string& folder);

/// The view in which a camera sees what another one took, given as photo of our camera (make_camera(): one
/// focal length, the principal point in the middle). With K_0, K_s, K_t the matrices of our camera, of the
/// source and of the target and (R, t) the motion between both, it is R' = K_0⁻¹ K_t R K_s⁻¹ K_0 and t' = K_0⁻¹
/// K_t t: any intrinsics without resampling either picture, depth as it is. R' is a rotation only if all three
/// are alike.
[[nodiscard]] View posed_view(const Camera& ours, const PosedCamera& source, const PosedCamera& target);

}  // namespace slide::eval
