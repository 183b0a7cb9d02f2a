#include "benchmarks/eval/posed_scene.h"

#include <cmath>
#include <filesystem>
#include <glm/matrix.hpp>
#include <nlohmann/json.hpp>
#include <string_view>

#include "render/image_file.h"
#include "render/write_image.h"
#include "runtime/error.h"

namespace slide::eval {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

std::string text_of(const fs::path& path) {
  const auto bytes = read_file(path.string());
  return {bytes.begin(), bytes.end()};
}

/// The cameras of a scene, whichever kind of file they are in.
struct CameraFile {
  std::string path;
  PosedCameras cameras;
  bool by_stem = false;  ///< a picture's name is looked up without its extension
  ColmapModel colmap;

  [[nodiscard]] const PosedCamera& of(const std::string& picture) const {
    return camera_of(cameras, by_stem ? fs::path(picture).stem().string() : picture, path);
  }
};

CameraFile read_cameras(const json& scene, const fs::path& folder) {
  CameraFile out;
  const auto path = [&](const char* key) { return folder / scene.at(key).get<std::string>(); };
  if (scene.contains("colmap")) {
    const fs::path model = path("colmap");
    out.path = (model / "images.txt").string();
    out.colmap = parse_colmap(text_of(model / "cameras.txt"), text_of(model / "images.txt"), model.string());
    out.cameras = out.colmap.cameras;
  } else if (scene.contains("realestate10k")) {
    out.path = path("realestate10k").string();
    out.cameras = parse_realestate10k(text_of(out.path), out.path);
    out.by_stem = true;
  } else if (scene.contains("cameras")) {
    out.path = path("cameras").string();
    out.cameras = parse_json_cameras(text_of(out.path), out.path);
  } else {
    throw Error(ErrorKind::kBadInput, (folder / "scene.json").string() + " names no cameras",
                "give cameras, colmap or realestate10k");
  }
  return out;
}

Image read_picture(const fs::path& path) { return read_photo(path.string()).colour; }

Image read_depth(const json& scene, const fs::path& folder, const Image& source) {
  const fs::path path = folder / scene.at("depth").get<std::string>();
  Image depth = read_map(path.string(), NonFinite::kKept);
  if (depth.width != source.width || depth.height != source.height)
    throw Error(ErrorKind::kBadInput, path.string() + " differs in size from the source");
  const double unit = scene.value("depth_unit", 1.0);
  const bool integers = lower_extension(path.string()) == ".png";  // read as parts of 65535
  for (float& v : depth.data) {
    const double z = static_cast<double>(v) * (integers ? 65535.0 : 1.0) * unit;
    v = std::isfinite(z) && z > 0 ? static_cast<float>(z) : 0.0F;
  }
  return depth;
}

std::vector<KnownDepth> known_depths(const Image& depth) {
  std::vector<KnownDepth> known;
  for (int y = 0; y < depth.height; ++y)
    for (int x = 0; x < depth.width; ++x)
      if (depth.at(x, y) > 0) known.push_back({x, y, 1 / static_cast<double>(depth.at(x, y))});
  return known;
}

std::vector<KnownDepth> seen_depths(const std::vector<SeenPoint>& seen,
                                    const std::map<std::int64_t, glm::dvec3>& points,
                                    const PosedCamera& camera, const Image& source) {
  std::vector<KnownDepth> known;
  for (const SeenPoint& s : seen) {
    const auto point = points.find(s.point);
    const int x = static_cast<int>(std::floor(s.x * source.width));
    const int y = static_cast<int>(std::floor(s.y * source.height));
    if (point == points.end() || x < 0 || x >= source.width || y < 0 || y >= source.height) continue;
    const double z = (camera.pose.rotation * point->second + camera.pose.translation).z;
    if (z > 0) known.push_back({x, y, 1 / z});
  }
  return known;
}

void read_targets(const json& scene, const fs::path& images, const CameraFile& cameras, PosedScene& out) {
  for (const json& target : scene.at("targets")) {
    const auto name = target.get<std::string>();
    out.targets.push_back({fs::path(name).stem().string(), read_picture(images / name), cameras.of(name)});
    const Image& picture = out.targets.back().picture;
    if (picture.width != out.source.width || picture.height != out.source.height)
      throw Error(ErrorKind::kBadInput, (images / name).string() + " differs in size from the source");
  }
}

void read_range(const json& scene, const std::string& file, PosedScene& out) {
  if (!scene.contains("near") && !scene.contains("far")) return;
  out.range = {scene.at("near").get<double>(), scene.at("far").get<double>()};
  if (!(out.range->near > 0 && out.range->far > out.range->near && std::isfinite(out.range->far)))
    throw Error(ErrorKind::kBadInput, file + ": 0 < near < far is needed");
}

/// Intrinsics of a camera for pixel centres at integers.
glm::dmat3 intrinsics(const PosedCamera& camera, const Camera& ours) {
  glm::dmat3 k(1.0);
  k[0][0] = camera.focal_x * ours.width;
  k[1][1] = camera.focal_y * ours.height;
  k[2][0] = camera.centre_x * ours.width - 0.5;
  k[2][1] = camera.centre_y * ours.height - 0.5;
  return k;
}

}  // namespace

PosedScene read_posed_scene(const std::string& folder_name) try {
  const fs::path folder = folder_name;
  const std::string file = (folder / "scene.json").string();
  const json scene = json::parse(text_of(file));
  PosedScene out;
  out.name = folder.filename().string();
  const fs::path images = folder / scene.value("images", std::string("."));
  const auto source = scene.at("source").get<std::string>();
  const CameraFile cameras = read_cameras(scene, folder);
  out.source = read_picture(images / source);
  out.camera = cameras.of(source);
  read_targets(scene, images, cameras, out);
  read_range(scene, file, out);
  if (scene.contains("depth")) {
    out.depth = read_depth(scene, folder, out.source);
    out.known = known_depths(out.depth);
  } else if (scene.contains("colmap")) {
    const fs::path points = folder / scene.at("colmap").get<std::string>() / "points3D.txt";
    const auto seen = cameras.colmap.seen.find(source);
    if (fs::exists(points) && seen != cameras.colmap.seen.end())
      out.known = seen_depths(seen->second, parse_colmap_points(text_of(points), points.string()), out.camera,
                              out.source);
  }
  if (out.known.empty() && !out.range)
    throw Error(ErrorKind::kBadInput, file + ": the scale of the scene's depth is unknown",
                "give near and far, a depth map, or COLMAP's points3D.txt");
  return out;
} catch (const json::exception& e) {
  throw Error(ErrorKind::kBadInput, folder_name + "/scene.json: " + e.what());
}

View posed_view(const Camera& ours, const PosedCamera& source, const PosedCamera& target) {
  glm::dmat3 k0(1.0);
  k0[0][0] = k0[1][1] = ours.focal;
  k0[2] = glm::dvec3(ours.centre(), 1.0);
  const glm::dmat3 to_ours = glm::inverse(k0) * intrinsics(target, ours);
  const glm::dmat3 rotation = target.pose.rotation * glm::transpose(source.pose.rotation);
  const glm::dvec3 translation = target.pose.translation - rotation * source.pose.translation;
  View view;
  view.pose.rotation = to_ours * rotation * glm::inverse(intrinsics(source, ours)) * k0;
  view.pose.translation = to_ours * translation;
  return view;
}

}  // namespace slide::eval
