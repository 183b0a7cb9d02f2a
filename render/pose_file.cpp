#include <cmath>
#include <fstream>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "render/camera_path.h"
#include "runtime/error.h"

namespace slide {
namespace {

using nlohmann::json;

constexpr std::size_t kMostFrames = 100000;
constexpr std::size_t kMostBytes = std::size_t{64} << 20;
constexpr double kLargestNumber = 1e6;
constexpr double kRotationTolerance = 1e-3;

/// Where in which file; turns what is wrong there into an error.
struct Place {
  std::string file;
  std::string where;

  [[noreturn]] void refuse(const std::string& problem) const {
    throw Error(ErrorKind::kBadInput, file + ": " + where + " " + problem);
  }
  [[nodiscard]] Place inside(const std::string& part) const { return {file, where + part}; }
};

double number(const json& value, const Place& place) {
  if (!value.is_number()) place.refuse("is no number");
  const auto result = value.get<double>();
  if (!(std::abs(result) <= kLargestNumber)) place.refuse("is beyond 1000000");
  return result;
}

template <typename Vector>
Vector vector(const json& value, const Place& place) {
  constexpr auto kLength = static_cast<std::size_t>(Vector::length());
  if (!value.is_array() || value.size() != kLength) {
    place.refuse("is not an array of " + std::to_string(kLength) + " numbers");
  }
  Vector result;
  for (std::size_t i = 0; i < kLength; ++i) {
    result[static_cast<typename Vector::length_type>(i)] =
        number(value[i], place.inside("[" + std::to_string(i) + "]"));
  }
  return result;
}

glm::dmat3 rotation(const json& value, const Place& place) {
  if (!value.is_array() || value.size() != 3) place.refuse("is not an array of 3 rows");
  glm::dvec3 rows[3];
  for (std::size_t i = 0; i < 3; ++i) {
    rows[i] = vector<glm::dvec3>(value[i], place.inside("[" + std::to_string(i) + "]"));
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j <= i; ++j) {
      if (!(std::abs(glm::dot(rows[i], rows[j]) - (i == j ? 1.0 : 0.0)) <= kRotationTolerance)) {
        place.refuse("is no rotation: its rows are not orthonormal");
      }
    }
  }
  // Gram-Schmidt; the third row is the cross product, so a reflection would differ from it.
  const glm::dvec3 x = glm::normalize(rows[0]);
  const glm::dvec3 y = glm::normalize(rows[1] - x * glm::dot(x, rows[1]));
  const glm::dvec3 z = glm::cross(x, y);
  if (glm::dot(z, rows[2]) < 0.0) place.refuse("is no rotation but a reflection: its determinant is -1");
  return glm::transpose(glm::dmat3(x, y, z));
}

View frame_view(const json& frame, const Place& place) {
  if (!frame.is_object()) place.refuse("is no object");
  View view;
  for (const auto& [key, value] : frame.items()) {
    const Place here = place.inside("." + key);
    if (key == "rotation") {
      view.pose.rotation = rotation(value, here);
    } else if (key == "translation") {
      view.pose.translation = vector<glm::dvec3>(value, here);
    } else if (key == "shift") {
      view.shift = vector<glm::dvec2>(value, here);
    } else if (key == "zoom") {
      view.zoom = number(value, here);
      if (!(view.zoom >= 0.01 && view.zoom <= 100.0)) here.refuse("is outside 0.01 to 100");
    } else {
      here.refuse("is unknown: a frame has rotation, translation, zoom and shift");
    }
  }
  return view;
}

json parse(std::string_view text, const std::string& name) {
  try {
    return json::parse(text);
  } catch (const json::exception& error) {
    throw Error(ErrorKind::kBadInput, name + ": not valid JSON: " + error.what());
  }
}

}  // namespace

std::vector<View> parse_poses(std::string_view text, const std::string& name) {
  const Place file{name, "the file"};
  if (text.size() > kMostBytes) file.refuse("is larger than 64 MiB");
  const json document = parse(text, name);
  if (!document.is_object()) file.refuse("is no JSON object");
  for (const auto& [key, value] : document.items()) {
    if (key != "frames") Place{name, key}.refuse("is unknown: a pose file has frames");
  }
  const Place place{name, "frames"};
  if (!document.contains("frames") || !document["frames"].is_array()) place.refuse("is missing or no array");
  const json& frames = document["frames"];
  if (frames.empty()) place.refuse("is empty");
  if (frames.size() > kMostFrames) place.refuse("has more than " + std::to_string(kMostFrames) + " entries");
  std::vector<View> views;
  views.reserve(frames.size());
  for (std::size_t i = 0; i < frames.size(); ++i) {
    views.push_back(frame_view(frames[i], place.inside("[" + std::to_string(i) + "]")));
  }
  return views;
}

std::vector<View> read_pose_file(const std::string& path) {
  std::ifstream stream(path, std::ios::binary);
  std::string text;
  std::vector<char> block(std::size_t{1} << 16);
  // One byte more than allowed is enough to see that a file is too large.
  while (stream && text.size() <= kMostBytes) {
    stream.read(block.data(), static_cast<std::streamsize>(block.size()));
    text.append(block.data(), static_cast<std::size_t>(stream.gcount()));
  }
  if (!stream.is_open() || stream.bad()) {
    throw Error(ErrorKind::kBadInput, path + ": the pose file cannot be read", "check that it exists");
  }
  return parse_poses(text, path);
}

}  // namespace slide
