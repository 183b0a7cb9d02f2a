#include <doctest/doctest.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>

#include "render/camera_path.h"
#include "runtime/error.h"

namespace slide {
namespace {

std::string refusal(const std::string& text) {
  try {
    (void)parse_poses(text, "poses.json");
  } catch (const Error& error) {
    CHECK(error.kind() == ErrorKind::kBadInput);
    return error.what();
  }
  return "";
}

/// The refusal names the file and this place.
void check_refused(const std::string& text, const std::string& place) {
  const std::string message = refusal(text);
  CAPTURE(text);
  CAPTURE(message);
  CHECK(message.find("poses.json") != std::string::npos);
  CHECK(message.find(place) != std::string::npos);
}

std::string frame(const std::string& body) { return "{\"frames\": [{}, {" + body + "}]}"; }

}  // namespace

TEST_CASE("poses are read by rows, with defaults for what is left out") {
  const std::vector<View> views = parse_poses(
      R"({"frames": [{"rotation": [[0,-1,0],[1,0,0],[0,0,1]], "translation": [1,2,3]}, {"zoom": 2, "shift": [4,-5]}]})",
      "poses.json");
  REQUIRE(views.size() == 2);
  const glm::dvec3 turned = views[0].pose.rotation * glm::dvec3(1, 0, 0);
  CHECK(turned.x == 0.0);
  CHECK(turned.y == 1.0);
  CHECK(views[0].pose.translation.z == 3.0);
  CHECK(views[0].zoom == 1.0);
  CHECK(views[1].pose.rotation == glm::dmat3(1.0));
  CHECK(views[1].zoom == 2.0);
  CHECK(views[1].shift.y == -5.0);
}

TEST_CASE("a rotation written with few digits is made orthonormal") {
  const View view =
      parse_poses(R"({"frames": [{"rotation": [[0.8661,0,0.5],[0,1,0],[-0.5,0,0.866]]}]})", "p")[0];
  const glm::dmat3 r = view.pose.rotation;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      double dot = 0.0;
      for (int k = 0; k < 3; ++k) dot += r[k][i] * r[k][j];
      CHECK(dot == doctest::Approx(i == j ? 1.0 : 0.0).epsilon(1e-12));
    }
  }
}

TEST_CASE("text that is not JSON is refused") {
  for (const char* text :
       {"", "{", "null,", "{\"frames\": [", "\xff\xfe", "{\"frames\": [1e999]}", "[NaN]"}) {
    check_refused(text, "poses.json");
  }
  check_refused(std::string(100000, '['), "not valid JSON");
  CHECK_FALSE(refusal(std::string(100000, '[') + std::string(100000, ']')).empty());
}

TEST_CASE("JSON of another shape is refused by place") {
  check_refused("[]", "no JSON object");
  check_refused("{}", "frames");
  check_refused("{\"frames\": {}}", "frames");
  check_refused("{\"frames\": []}", "frames is empty");
  check_refused("{\"frames\": [7]}", "frames[0]");
  check_refused("{\"frames\": [{}], \"poses\": 1}", "poses is unknown");
  check_refused(frame("\"rotatoin\": []"), "frames[1].rotatoin is unknown");
  check_refused(frame("\"translation\": [1, 2]"), "frames[1].translation");
  check_refused(frame("\"translation\": [1, 2, \"x\"]"), "frames[1].translation[2]");
  check_refused(frame("\"translation\": [1, 2, 3e6]"), "frames[1].translation[2]");
  check_refused(frame("\"zoom\": 0"), "frames[1].zoom");
  check_refused(frame("\"zoom\": null"), "frames[1].zoom");
  check_refused(frame("\"shift\": 3"), "frames[1].shift");
}

TEST_CASE("matrices that are no rotations are refused") {
  check_refused(frame("\"rotation\": [[1,0,0],[0,1,0]]"), "frames[1].rotation");
  check_refused(frame("\"rotation\": [[1,0,0],[0,1,0],[0,0]]"), "frames[1].rotation[2]");
  check_refused(frame("\"rotation\": [[0,0,0],[0,0,0],[0,0,0]]"), "no rotation");
  check_refused(frame("\"rotation\": [[1.1,0,0],[0,1,0],[0,0,1]]"), "no rotation");
  check_refused(frame("\"rotation\": [[1,0.1,0],[0,1,0],[0,0,1]]"), "no rotation");
  check_refused(frame("\"rotation\": [[1,0,0],[0,1,0],[0,0,-1]]"), "reflection");
}

TEST_CASE("too many frames are refused") {
  std::string text = "{\"frames\": [{}";
  for (int i = 0; i < 100000; ++i) text += ",{}";
  check_refused(text + "]}", "more than 100000");
}

TEST_CASE("a pose file is read, and one that is missing or a folder is refused by name") {
  const std::filesystem::path path = std::filesystem::temp_directory_path() / "slide_pose_file_test.json";
  std::ofstream(path) << "{\"frames\": [{\"translation\": [0.25, 0, 0]}]}";
  CHECK(read_pose_file(path.string())[0].pose.translation.x == 0.25);
  std::filesystem::remove(path);
  CHECK_THROWS_WITH_AS((void)read_pose_file(path.string()), doctest::Contains("slide_pose_file_test.json"),
                       Error);
  CHECK_THROWS_WITH_AS((void)read_pose_file("/"), doctest::Contains("/"), Error);
}

}  // namespace slide
