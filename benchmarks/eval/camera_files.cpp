#include "benchmarks/eval/camera_files.h"

#include <cmath>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/matrix.hpp>
#include <nlohmann/json.hpp>
#include <sstream>

#include "runtime/error.h"

namespace slide::eval {
namespace {

constexpr double kRotationTolerance = 1e-3;

[[noreturn]] void refuse(const std::string& where, const std::string& problem,
                         const std::string& remedy = "") {
  throw Error(ErrorKind::kBadInput, where + " " + problem, remedy);
}

/// A camera that is one: finite, focal lengths positive, a rotation.
PosedCamera checked(const PosedCamera& camera, const std::string& where) {
  const auto finite = [&](double v) {
    if (!std::isfinite(v)) refuse(where, "has a number that is not finite");
  };
  for (const double v : {camera.focal_x, camera.focal_y, camera.centre_x, camera.centre_y}) finite(v);
  for (int i = 0; i < 3; ++i) {
    finite(camera.pose.translation[i]);
    for (int j = 0; j < 3; ++j) finite(camera.pose.rotation[i][j]);
  }
  if (!(camera.focal_x > 0 && camera.focal_y > 0)) refuse(where, "has a focal length that is not positive");
  const glm::dmat3 product = camera.pose.rotation * glm::transpose(camera.pose.rotation);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (!(std::fabs(product[i][j] - (i == j ? 1 : 0)) <= kRotationTolerance))
        refuse(where, "has a matrix that is no rotation: its rows are not orthonormal");
  if (glm::determinant(camera.pose.rotation) < 0) refuse(where, "has a matrix that is a reflection");
  return camera;
}

/// The lines of a text file without comments; empty ones stay.
struct Line {
  int number;
  std::string text;
};
std::vector<Line> lines_of(std::string_view text) {
  std::istringstream stream{std::string(text)};
  std::vector<Line> lines;
  std::string line;
  for (int number = 1; std::getline(stream, line); ++number) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (!line.starts_with('#')) lines.push_back({number, line});
  }
  return lines;
}

std::string place(const std::string& file, const Line& line) {
  return file + ": line " + std::to_string(line.number);
}

/// Reads words and numbers of a line one after the other.
class Words {
 public:
  Words(const std::string& file, const Line& line) : where_(place(file, line)), stream_(line.text) {}
  template <typename T>
  T next(const char* what) {
    T value{};
    if (!(stream_ >> value)) refuse(where_, std::string("lacks ") + what);
    return value;
  }
  /// What is left, without the blank before it.
  std::string rest() {
    std::string text;
    std::getline(stream_ >> std::ws, text);
    return text;
  }
  [[nodiscard]] bool more() { return static_cast<bool>(stream_ >> std::ws) && stream_.peek() != EOF; }
  [[nodiscard]] const std::string& where() const noexcept { return where_; }

 private:
  std::string where_;
  std::istringstream stream_;
};

/// A camera of cameras.txt, without a pose; and the size that its pixels are of.
struct ColmapCamera {
  PosedCamera camera;
  double width, height;
};

std::map<std::int64_t, ColmapCamera> colmap_cameras(std::string_view text, const std::string& file) {
  std::map<std::int64_t, ColmapCamera> cameras;
  for (const Line& line : lines_of(text)) {
    if (line.text.find_first_not_of(" \t") == std::string::npos) continue;
    Words words(file, line);
    const auto id = words.next<std::int64_t>("a camera's number");
    const auto model = words.next<std::string>("a model");
    const auto width = words.next<double>("a width");
    const auto height = words.next<double>("a height");
    if (model != "PINHOLE" && model != "SIMPLE_PINHOLE")
      refuse(words.where(), "has a camera of the model " + model,
             "undistort the pictures first (colmap image_undistorter): PINHOLE and SIMPLE_PINHOLE are read");
    if (!(width > 0 && height > 0)) refuse(words.where(), "has a size that is not positive");
    const auto focal = words.next<double>("a focal length");
    const double focal_y = model == "PINHOLE" ? words.next<double>("a focal length") : focal;
    const auto cx = words.next<double>("a principal point");
    const auto cy = words.next<double>("a principal point");
    cameras[id] = {{focal / width, focal_y / height, cx / width, cy / height, {}}, width, height};
  }
  return cameras;
}

std::vector<SeenPoint> seen_points(const Line& line, const std::string& file, const ColmapCamera& camera) {
  std::vector<SeenPoint> seen;
  Words words(file, line);
  while (words.more()) {
    const auto x = words.next<double>("a point's x");
    const auto y = words.next<double>("a point's y");
    const auto point = words.next<std::int64_t>("a point's number");
    if (point >= 0) seen.push_back({x / camera.width, y / camera.height, point});
  }
  return seen;
}

glm::dmat3 rows_matrix(const double (&m)[9]) {
  return glm::transpose(glm::dmat3(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]));
}

PosedCamera json_camera(const nlohmann::json& json, const std::string& where) {
  const auto number = [&](const char* key) { return json.at(key).get<double>(); };
  const double width = number("w");
  const double height = number("h");
  if (!(width > 0 && height > 0)) refuse(where, "has a size that is not positive");
  const auto vector = [&](const nlohmann::json& v) {
    return glm::dvec3(v.at(0).get<double>(), v.at(1).get<double>(), v.at(2).get<double>());
  };
  PosedCamera camera{number("fx") / width,
                     number("fy") / height,
                     (number("cx") + 0.5) / width,
                     (number("cy") + 0.5) / height,
                     {}};
  const nlohmann::json& r = json.at("R");
  camera.pose.rotation = glm::transpose(glm::dmat3(vector(r.at(0)), vector(r.at(1)), vector(r.at(2))));
  camera.pose.translation =
      json.contains("t") ? vector(json.at("t")) : -(camera.pose.rotation * vector(json.at("C")));
  return checked(camera, where);
}

}  // namespace

PosedCameras parse_json_cameras(std::string_view text, const std::string& name) {
  PosedCameras cameras;
  std::string where = name + ":";
  try {
    const auto json = nlohmann::json::parse(text);
    const nlohmann::json& list = json.at("cameras");
    for (std::size_t i = 0; i < list.size(); ++i) {
      where = name + ": cameras[" + std::to_string(i) + "]";
      const nlohmann::json& camera = list.at(i);
      cameras[camera.at("file").get<std::string>()] = json_camera(camera, where);
    }
  } catch (const nlohmann::json::exception& e) {
    refuse(where, std::string("cannot be read: ") + e.what());
  }
  return cameras;
}

ColmapModel parse_colmap(std::string_view cameras, std::string_view images, const std::string& folder) {
  const std::map<std::int64_t, ColmapCamera> known = colmap_cameras(cameras, folder + "/cameras.txt");
  const std::string file = folder + "/images.txt";
  const std::vector<Line> lines = lines_of(images);
  ColmapModel model;
  // Two lines a picture: the second one, its points, may be empty.
  for (std::size_t i = 0; i < lines.size(); i += 2) {
    if (lines[i].text.find_first_not_of(" \t") == std::string::npos) break;
    Words words(file, lines[i]);
    (void)words.next<std::int64_t>("an image's number");
    glm::dquat q;
    q.w = words.next<double>("a rotation");
    q.x = words.next<double>("a rotation");
    q.y = words.next<double>("a rotation");
    q.z = words.next<double>("a rotation");
    glm::dvec3 t;
    for (int j = 0; j < 3; ++j) t[j] = words.next<double>("a translation");
    const auto id = words.next<std::int64_t>("a camera's number");
    const std::string name = words.rest();
    const auto camera = known.find(id);
    if (camera == known.end())
      refuse(words.where(), "names camera " + std::to_string(id) + ", which cameras.txt does not have");
    PosedCamera posed = camera->second.camera;
    posed.pose = {glm::mat3_cast(q), t};
    model.cameras[name] = checked(posed, words.where());
    if (i + 1 < lines.size()) model.seen[name] = seen_points(lines[i + 1], file, camera->second);
  }
  return model;
}

std::map<std::int64_t, glm::dvec3> parse_colmap_points(std::string_view text, const std::string& name) {
  std::map<std::int64_t, glm::dvec3> points;
  for (const Line& line : lines_of(text)) {
    if (line.text.find_first_not_of(" \t") == std::string::npos) continue;
    Words words(name, line);
    const auto id = words.next<std::int64_t>("a point's number");
    glm::dvec3& point = points[id];
    for (int i = 0; i < 3; ++i) point[i] = words.next<double>("a point's place");
  }
  return points;
}

PosedCameras parse_realestate10k(std::string_view text, const std::string& name) {
  const std::vector<Line> lines = lines_of(text);
  PosedCameras cameras;
  for (std::size_t i = 1; i < lines.size(); ++i) {
    if (lines[i].text.find_first_not_of(" \t") == std::string::npos) continue;
    Words words(name, lines[i]);
    const auto timestamp = words.next<std::string>("a timestamp");
    PosedCamera camera{};
    for (double* v : {&camera.focal_x, &camera.focal_y, &camera.centre_x, &camera.centre_y})
      *v = words.next<double>("an intrinsic number");
    for (int zero = 0; zero < 2; ++zero)
      if (words.next<double>("a distortion") != 0) refuse(words.where(), "has a lens distortion");
    double m[9];
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) m[3 * row + column] = words.next<double>("a rotation");
      camera.pose.translation[row] = words.next<double>("a translation");
    }
    camera.pose.rotation = rows_matrix(m);
    cameras[timestamp] = checked(camera, words.where());
  }
  return cameras;
}

const PosedCamera& camera_of(const PosedCameras& cameras, const std::string& picture,
                             const std::string& file) {
  const auto found = cameras.find(picture);
  if (found == cameras.end())
    throw Error(ErrorKind::kBadInput, file + " has no camera of the picture " + picture);
  return found->second;
}

}  // namespace slide::eval
