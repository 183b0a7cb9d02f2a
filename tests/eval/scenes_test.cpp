#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "benchmarks/eval/image_metrics.h"
#include "benchmarks/eval/layerings.h"
#include "benchmarks/eval/matte_scene.h"
#include "benchmarks/eval/posed_scene.h"
#include "benchmarks/eval/report.h"
#include "benchmarks/eval/result.h"
#include "render/write_image.h"
#include "runtime/error.h"
#include "tests/temporary_folder.h"

using namespace slide;
using namespace slide::eval;

namespace {

void write_text(const std::string& path, const std::string& text) {
  write_bytes(path, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

const Entry& entry(const SceneResult& r, const std::string& method) {
  const auto found = std::ranges::find(r.entries, method, &Entry::method);
  REQUIRE(found != r.entries.end());
  return *found;
}

double figure(const SceneResult& r, const std::string& method, const std::string& name) {
  const Entry& e = entry(r, method);
  const auto found = std::ranges::find(e.figures, name, &Figure::name);
  REQUIRE(found != e.figures.end());
  return found->value;
}

/// A picture whose colours are linear in the place.
constexpr int kWidth = 96;
constexpr int kHeight = 72;
double ramp(double x, double y, int c) { return c == 0 ? x / 200 : c == 1 ? y / 150 : 0.2 + (x + y) / 400; }

const PosedCamera kSource{0.9, 1.1, 0.52, 0.47, {}};
PosedCamera target_camera() {
  PosedCamera c{1.0, 1.3, 0.46, 0.55, {}};
  c.pose.translation = {0.3, -0.2, 0.4};
  return c;
}

/// Where a point of the plane at depth 5 that the target shows at (x, y) lies in the source.
glm::dvec2 in_source(double x, double y) {
  const PosedCamera t = target_camera();
  const double z = 5 + 0.4;
  const double px = (x + 0.5 - t.centre_x * kWidth) / (t.focal_x * kWidth) * z - 0.3;
  const double py = (y + 0.5 - t.centre_y * kHeight) / (t.focal_y * kHeight) * z + 0.2;
  return {kSource.focal_x * kWidth * px / 5 + kSource.centre_x * kWidth - 0.5,
          kSource.focal_y * kHeight * py / 5 + kSource.centre_y * kHeight - 0.5};
}

Image source_picture() {
  Image out(kWidth, kHeight, 3);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (int c = 0; c < 3; ++c) out.at(x, y, c) = static_cast<float>(ramp(x, y, c));
  return out;
}
Image target_picture() {
  Image out(kWidth, kHeight, 3);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (int c = 0; c < 3; ++c) {
        const glm::dvec2 s = in_source(x, y);
        out.at(x, y, c) = static_cast<float>(std::clamp(ramp(s.x, s.y, c), 0.0, 1.0));
      }
  return out;
}

constexpr const char* kCameras = R"({"cameras": [
  {"file": "a.png", "w": 96, "h": 72, "fx": 86.4, "fy": 79.2, "cx": 49.42, "cy": 33.34, "t": [0, 0, 0],
   "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]},
  {"file": "b.png", "w": 96, "h": 72, "fx": 96, "fy": 93.6, "cx": 43.66, "cy": 39.1, "t": [0.3, -0.2, 0.4],
   "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}]})";

/// The plane at depth 5, but for a corner that is farther: a depth map has a range.
void write_posed_scene(const std::string& folder, const std::string& json) {
  write_png(folder + "/a.png", source_picture(), 16);
  write_png(folder + "/b.png", target_picture(), 16);
  Image depth(kWidth, kHeight, 1, 5);
  depth.at(0, 0) = 6;
  write_pfm(folder + "/depth.pfm", depth);
  write_text(folder + "/cameras.json", kCameras);
  write_text(folder + "/scene.json", json);
}

/// A subject of 40×30 pixels at (50, 30), red before a background that brightens to the right.
MatteScene write_matte_scene(const std::string& folder) {
  constexpr int kW = 140;
  constexpr int kH = 90;
  Image fg(kW, kH, 3);
  Image bg(kW, kH, 3);
  Image alpha(kW, kH, 1);
  for (int y = 0; y < kH; ++y)
    for (int x = 0; x < kW; ++x) {
      fg.at(x, y, 0) = 0.8F;
      for (int c = 0; c < 3; ++c) bg.at(x, y, c) = static_cast<float>(x) / 200;
      alpha.at(x, y) = x >= 50 && x < 90 && y >= 30 && y < 60 ? 1.0F : 0.0F;
    }
  write_jpeg(folder + "/box_fg.jpg", fg, 100);
  write_jpeg(folder + "/box_bg.jpg", bg, 100);
  write_png(folder + "/box_alpha.png", alpha);
  return read_matte_scene(folder + "/box_alpha.png");
}

double count(const Image& mask) { return mask_fraction(mask) * static_cast<double>(mask.pixels()); }

}  // namespace

TEST_CASE("a posed view takes points where the target's camera sees them") {
  const Camera ours = make_camera(kWidth, kHeight, kDefaultFov, 2, 10);
  PosedCamera source = kSource;
  const double c = std::cos(0.3);
  const double s = std::sin(0.3);
  source.pose = {glm::transpose(glm::dmat3(c, 0, s, 0, 1, 0, -s, 0, c)), {0.1, 0.5, -0.2}};
  const PosedCamera target = target_camera();
  const View view = posed_view(ours, source, target);
  for (const glm::dvec3& p : {glm::dvec3(20, 30, 0.25), glm::dvec3(70, 11, 0.9)}) {
    // p.z is disparity; from the source's pixel to its camera, the world and the target, step by step.
    const double z = 1 / ours.inverse_depth(p.z);
    const double x = (p.x + 0.5 - 0.52 * kWidth) / (0.9 * kWidth) * z - 0.1;
    const double y = (p.y + 0.5 - 0.47 * kHeight) / (1.1 * kHeight) * z - 0.5;
    const double d = z + 0.2;
    const glm::dvec3 world(c * x - s * d, y, s * x + c * d);
    const glm::dvec3 there = world + glm::dvec3(0.3, -0.2, 0.4);
    const glm::dvec2 seen = project(ours, view, back_project(ours, p.x, p.y, p.z));
    CHECK(seen.x == doctest::Approx(1.0 * kWidth * there.x / there.z + 0.46 * kWidth - 0.5).epsilon(1e-12));
    CHECK(seen.y == doctest::Approx(1.3 * kHeight * there.y / there.z + 0.55 * kHeight - 0.5).epsilon(1e-12));
  }
}

TEST_CASE("a posed scene of a plane is rendered as it is") {
  const TemporaryFolder temporary;
  const std::string folder = temporary.path().string();
  write_posed_scene(folder, R"({"kind": "posed", "source": "a.png", "targets": ["b.png"],
    "cameras": "cameras.json", "depth": "depth.pfm"})");
  const std::vector<SceneResult> results = run_posed(folder, {});
  REQUIRE(results.size() == 1);
  CHECK(figure(results[0], "given depth, single layer", "psnr") > 55);
  CHECK(figure(results[0], "given depth, soft, fill", "psnr") > 55);
  CHECK(figure(results[0], "given depth, soft, fill", "covered") == 1);
  CHECK(figure(results[0], "still", "psnr") < 40);
  const nlohmann::json json = to_json(results);
  CHECK(json["means"]["posed"]["still"]["psnr"] == json["scenes"][0]["methods"]["still"]["psnr"]);
}

TEST_CASE("posed scenes that say too little are refused") {
  const TemporaryFolder temporary;
  const std::string folder = temporary.path().string();
  const auto message = [&](const std::string& json) -> std::string {
    write_posed_scene(folder, json);
    try {
      (void)read_posed_scene(folder);
    } catch (const Error& e) {
      CHECK(e.kind() == ErrorKind::kBadInput);
      return e.what();
    }
    return "";
  };
  const std::string pictures = R"({"source": "a.png", "targets": ["b.png"])";
  CHECK(message(pictures + R"(, "cameras": "cameras.json"})").find("scale") != std::string::npos);
  CHECK(message(pictures + R"(, "near": 1, "far": 9})").find("names no cameras") != std::string::npos);
  CHECK(message(pictures + R"(, "cameras": "cameras.json", "near": 9, "far": 1})").find("near < far") !=
        std::string::npos);
  CHECK(message(R"({"targets": [])").find("scene.json") != std::string::npos);
}

TEST_CASE("a matte scene's truth and masks are what its shape says") {
  const TemporaryFolder temporary;
  const std::string folder = temporary.path().string();
  const MatteScene scene = write_matte_scene(folder);
  CHECK(count(core(scene)) == (40 - 8) * (30 - 8));
  // The outline lies one pixel outside the box without its corners; the rim within 24 steps of it.
  CHECK(rim(scene).at(49 - 24, 45) == 1);
  CHECK(rim(scene).at(49 - 25, 45) == 0);
  CHECK(rim(scene).at(70, 45) == 1);
  const Image both = rim_of_view(scene, 20);
  CHECK(both.at(110 + 24, 45) == 0);  // the picture's side is left out
  CHECK(both.at(117, 45) == 1);
  CHECK(both.at(118, 45) == 0);
  const Image view = true_view(scene, 20);
  CHECK(view.at(109, 45, 0) == doctest::Approx(0.8).epsilon(0.02));
  CHECK(view.at(60, 45, 0) == doctest::Approx(0.3).epsilon(0.02));
  const Camera camera = matte_camera(scene);
  const glm::dvec2 near = project(camera, matte_view(scene, 20), back_project(camera, 60, 45, 1));
  CHECK(near.x == doctest::Approx(80).epsilon(1e-9));
  const glm::dvec2 far = project(camera, matte_view(scene, 20), back_project(camera, 60, 45, 0));
  CHECK(std::fabs(far.x - 60) < 1e-4);
}

TEST_CASE("a network's disparity is fitted by its medians, within the rim") {
  const TemporaryFolder temporary;
  const std::string folder = temporary.path().string();
  const MatteScene scene = write_matte_scene(folder);
  Image d = true_disparity(scene);
  for (float& v : d.data) v = 0.3F + 0.4F * v;
  d.at(55, 45) = 0.5F;  // half way, in the rim
  d.at(5, 5) = 0.9F;    // outside
  const Image fitted = fitted_disparity(scene, d);
  CHECK(fitted.at(55, 45) == doctest::Approx(0.5).epsilon(1e-5));
  CHECK(fitted.at(5, 5) == 0);
  CHECK(fitted.at(60, 40) == doctest::Approx(1).epsilon(1e-5));
}

TEST_CASE("with its depth known a matte scene comes closer than the photo itself") {
  const TemporaryFolder temporary;
  const std::string folder = temporary.path().string();
  (void)write_matte_scene(folder);
  const SceneResult r = run_matte(folder + "/box_alpha.png", {});
  CHECK(figure(r, "given depth", "psnr") > figure(r, "still", "psnr") + 6);
  CHECK(figure(r, "given depth", "gmsd_full") < figure(r, "still", "gmsd_full"));
  CHECK(figure(r, "given depth", "core") == 0);
  CHECK(figure(r, "given depth, true matte", "flip") < figure(r, "still", "flip"));
}

TEST_CASE("a line is fitted by least squares, and never falls") {
  LineFit rising;
  for (const double d : {0.0, 0.5, 1.0}) rising.add(d, 3 + 2 * d + (d == 0.5 ? 0.3 : 0));
  CHECK(rising.result().base == doctest::Approx(3.1));
  CHECK(rising.result().range == doctest::Approx(2));
  LineFit falling;
  falling.add(0, 2);
  falling.add(1, 1);
  CHECK(falling.result().base == doctest::Approx(1.5));
  CHECK(falling.result().range == 0);
}

TEST_CASE("layering follows the parallax by the multiples chosen") {
  LayeringChoice choice;
  choice.beta = 0.25;
  choice.gamma = 2;
  choice.rho = 3;
  const graphs::Layering l = graphs::resolve(choice.params(20));
  CHECK(l.beta == doctest::Approx(100));
  CHECK(l.gamma == doctest::Approx(40));
  CHECK(l.rho == doctest::Approx(0.15));
  CHECK(graphs::resolve(LayeringChoice().params(20)).beta == doctest::Approx(400.0 / 12));
}
