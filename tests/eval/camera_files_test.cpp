#include "benchmarks/eval/camera_files.h"

#include <doctest/doctest.h>

#include <cmath>
#include <string>

#include "runtime/error.h"

using namespace slide;
using namespace slide::eval;

namespace {

// One camera: 640×480, focal lengths 500 and 510, the principal point at (320.5, 240.25) from the corner; turned by
// 60 degrees about y, cos 30 = 0.8660254037844386, at t = (1, 2, 3).
constexpr const char* kJson = R"({"note": 1, "cameras": [{"file": "a b.png", "w": 640, "h": 480, "fx": 500,
  "fy": 510, "cx": 320, "cy": 239.75, "t": [1, 2, 3],
  "R": [[0.5, 0, 0.8660254037844386], [0, 1, 0], [-0.8660254037844386, 0, 0.5]]}]})";
constexpr const char* kColmapCameras = "# comment\n7 PINHOLE 640 480 500 510 320.5 240.25\n";
constexpr const char* kColmapImages =
    "# comment\n1 0.8660254037844387 0 0.5 0 1 2 3 7 a b.png\n64 120 5 320 240 -1 639 479 9\n"
    "2 1 0 0 0 0 0 0 7 c.png\n\n";
constexpr const char* kRealEstate =
    "https://video\n"
    "4711 0.78125 1.0625 0.50078125 0.5005208333333333 0 0 0.5 0 0.8660254037844386 1 0 1 0 2 "
    "-0.8660254037844386 0 0.5 3\n";

void check_camera(const PosedCamera& c) {
  CHECK(c.focal_x == doctest::Approx(500.0 / 640).epsilon(1e-12));
  CHECK(c.focal_y == doctest::Approx(510.0 / 480).epsilon(1e-12));
  CHECK(c.centre_x == doctest::Approx(320.5 / 640).epsilon(1e-12));
  CHECK(c.centre_y == doctest::Approx(240.25 / 480).epsilon(1e-12));
  // The point (2, 0, 4) of the world: R·X = (0.5·2 + cos 30·4, 0, -cos 30·2 + 0.5·4).
  const glm::dvec3 at = c.pose.rotation * glm::dvec3(2, 0, 4) + c.pose.translation;
  CHECK(at.x == doctest::Approx(1 + 1 + 4 * 0.8660254037844386).epsilon(1e-12));
  CHECK(at.y == doctest::Approx(2).epsilon(1e-12));
  CHECK(at.z == doctest::Approx(3 + 2 - 2 * 0.8660254037844386).epsilon(1e-12));
}

std::string message_of(const std::string& text, PosedCameras (*parse)(std::string_view, const std::string&)) {
  try {
    (void)parse(text, "FILE");
  } catch (const Error& e) {
    CHECK(e.kind() == ErrorKind::kBadInput);
    return e.what();
  }
  return "";
}

bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  return text.replace(text.find(from), from.size(), to);
}

}  // namespace

TEST_CASE("the three kinds of camera files say the same of one camera") {
  check_camera(camera_of(parse_json_cameras(kJson, "FILE"), "a b.png", "FILE"));
  check_camera(camera_of(parse_colmap(kColmapCameras, kColmapImages, "F").cameras, "a b.png", "F"));
  check_camera(camera_of(parse_realestate10k(kRealEstate, "FILE"), "4711", "FILE"));
}

TEST_CASE("a camera's centre may stand for its translation") {
  // C = -Rᵀ t
  const std::string text =
      replaced(kJson, "\"t\": [1, 2, 3]", "\"C\": [2.098076211353316, -2, -2.3660254037844384]");
  check_camera(camera_of(parse_json_cameras(text, "FILE"), "a b.png", "FILE"));
}

TEST_CASE("COLMAP's points are found where a picture shows them") {
  const ColmapModel model = parse_colmap(kColmapCameras, kColmapImages, "F");
  const std::vector<SeenPoint>& seen = model.seen.at("a b.png");
  REQUIRE(seen.size() == 2);
  CHECK(seen[0].x == doctest::Approx(0.1));
  CHECK(seen[0].y == doctest::Approx(0.25));
  CHECK(seen[1].point == 9);
  CHECK(model.seen.at("c.png").empty());
  const auto points = parse_colmap_points("# c\n5 1 2 3 0 0 0 0.5 1 0\n9 -1 0.5 8 0 0 0 0.5\n", "P");
  CHECK(points.at(9).z == 8);
}

TEST_CASE("damaged camera files are refused by place and reason") {
  CHECK(has(message_of(replaced(kJson, "\"fy\": 510", "\"fy\": 0"), parse_json_cameras), "cameras[0]"));
  CHECK(
      has(message_of(replaced(kJson, "0.5, 0, 0.866", "0.6, 0, 0.866"), parse_json_cameras), "no rotation"));
  CHECK(has(message_of(replaced(kJson, "[0, 1, 0]", "[0, -1, 0]"), parse_json_cameras), "reflection"));
  CHECK(has(message_of("{\"cameras\": [", parse_json_cameras), "FILE"));
  CHECK(has(message_of("{\"cameras\": [{}]}", parse_json_cameras), "cameras[0]"));
  CHECK(has(message_of("url\n1 0.5 0.5\n", parse_realestate10k), "line 2"));
  CHECK(has(message_of(replaced(kRealEstate, " 0 0 0.5", " 0.1 0 0.5"), parse_realestate10k), "distortion"));
  CHECK_THROWS_WITH_AS((void)parse_colmap("7 OPENCV 640 480 500 510 320 240 0 0 0 0\n", kColmapImages, "F"),
                       doctest::Contains("image_undistorter"), Error);
  CHECK_THROWS_WITH_AS((void)parse_colmap("8 PINHOLE 640 480 500 510 320 240\n", kColmapImages, "F"),
                       doctest::Contains("camera 7"), Error);
  CHECK_THROWS_WITH_AS((void)camera_of(parse_json_cameras(kJson, "FILE"), "b.png", "FILE"),
                       doctest::Contains("b.png"), Error);
}
