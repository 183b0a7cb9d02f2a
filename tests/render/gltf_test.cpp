#include "render/gltf.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <span>

#include "render/image_file.h"
#include "runtime/error.h"
#include "tests/render/decoders.h"
#include "tests/render/sample_scene.h"

namespace {

using Json = nlohmann::json;

struct Glb {
  Json json;
  std::vector<std::uint8_t> buffer;

  template <typename T>
  [[nodiscard]] std::vector<T> values(int accessor) const {
    const Json& a = json["accessors"][static_cast<std::size_t>(accessor)];
    const Json& view = json["bufferViews"][a["bufferView"].get<std::size_t>()];
    std::vector<T> out(view["byteLength"].get<std::size_t>() / sizeof(T));
    std::memcpy(out.data(), buffer.data() + view["byteOffset"].get<std::size_t>(), out.size() * sizeof(T));
    return out;
  }
  [[nodiscard]] std::span<const std::uint8_t> image(std::size_t index) const {
    const Json& view = json["bufferViews"][json["images"][index]["bufferView"].get<std::size_t>()];
    return std::span(buffer).subspan(view["byteOffset"].get<std::size_t>(),
                                     view["byteLength"].get<std::size_t>());
  }
};

std::uint32_t u32(std::span<const std::uint8_t> bytes, std::size_t at) {
  std::uint32_t v = 0;
  std::memcpy(&v, bytes.data() + at, 4);
  return v;
}

Glb parse(const std::vector<std::uint8_t>& bytes) {
  REQUIRE(std::string(bytes.begin(), bytes.begin() + 4) == "glTF");
  REQUIRE(u32(bytes, 4) == 2);
  REQUIRE(u32(bytes, 8) == bytes.size());
  const std::size_t json_size = u32(bytes, 12);
  const std::size_t buffer_at = 20 + json_size + 8;
  REQUIRE(buffer_at + u32(bytes, 20 + json_size) == bytes.size());
  return {Json::parse(bytes.begin() + 20, bytes.begin() + 20 + static_cast<std::ptrdiff_t>(json_size)),
          {bytes.begin() + static_cast<std::ptrdiff_t>(buffer_at), bytes.end()}};
}

}  // namespace

TEST_CASE("In a GLB, every vertex seen through the file's camera falls on its own texture coordinates") {
  const slide::Camera camera = slide::make_camera(48, 32, 60, 1, 10);
  const Glb glb = parse(slide::encode_glb(sample_scene(48, 32), camera, {.depth = slide::GlbDepth::kTrue}));
  const Json& lens = glb.json["cameras"][0]["perspective"];
  const double tan_y = std::tan(lens["yfov"].get<double>() / 2);
  const double tan_x = tan_y * lens["aspectRatio"].get<double>();
  CHECK(tan_x == doctest::Approx(std::tan(30 * 3.14159265358979 / 180)));
  REQUIRE(glb.json["meshes"].size() == 2);
  for (const Json& mesh : glb.json["meshes"]) {
    const Json& attributes = mesh["primitives"][0]["attributes"];
    const std::vector<float> p = glb.values<float>(attributes["POSITION"]);
    const std::vector<float> uv = glb.values<float>(attributes["TEXCOORD_0"]);
    REQUIRE(p.size() / 3 == uv.size() / 2);
    REQUIRE(p.size() >= 12);
    for (std::size_t i = 0; i < p.size() / 3; ++i) {
      const double depth = -p[3 * i + 2];  // looking along -z
      CHECK(depth >= 1 - 1e-5);
      CHECK(depth <= 10 + 1e-5);
      CHECK(p[3 * i] / depth / tan_x == doctest::Approx(2 * uv[2 * i] - 1).epsilon(1e-5));
      CHECK(p[3 * i + 1] / depth / tan_y == doctest::Approx(1 - 2 * uv[2 * i + 1]).epsilon(1e-5));  // y up
    }
    const Json& accessor = glb.json["accessors"][attributes["POSITION"].get<std::size_t>()];
    for (std::size_t c = 0; c < 3; ++c) {
      float low = p[c];
      float high = p[c];
      for (std::size_t i = c; i < p.size(); i += 3) {
        low = std::min(low, p[i]);
        high = std::max(high, p[i]);
      }
      CHECK(accessor["min"][c].get<float>() == low);
      CHECK(accessor["max"][c].get<float>() == high);
    }
  }
}

TEST_CASE("A GLB is a shallow relief about the origin by default, and its camera sees the photo") {
  for (const auto& [width, height] : {std::pair(48, 32), std::pair(32, 48)}) {
    const slide::Layers scene = sample_scene(width, height);
    const Glb glb =
        parse(slide::encode_glb(scene, slide::make_camera(width, height, 5, 2, 700), {.focus = 1}));
    const Json& lens = glb.json["cameras"][0]["perspective"];
    const double tan_y = std::tan(lens["yfov"].get<double>() / 2);
    const double tan_x = tan_y * lens["aspectRatio"].get<double>();
    CHECK(std::max(tan_x, tan_y) == doctest::Approx(std::tan(20 * 3.14159265358979 / 180)));
    const double distance = glb.json["nodes"][0]["translation"][2].get<double>();
    // The nearest plane lies at the origin, and the photo's longer side is 1 there.
    CHECK(2 * distance * std::max(tan_x, tan_y) == doctest::Approx(1));
    double farthest = 0;
    for (const Json& mesh : glb.json["meshes"]) {
      const Json& attributes = mesh["primitives"][0]["attributes"];
      const std::vector<float> p = glb.values<float>(attributes["POSITION"]);
      const std::vector<float> uv = glb.values<float>(attributes["TEXCOORD_0"]);
      REQUIRE(p.size() >= 12);
      for (std::size_t i = 0; i < p.size() / 3; ++i) {
        const double depth = distance - p[3 * i + 2];
        farthest = std::max(farthest, depth / distance);
        CHECK(depth >= distance - 1e-5);
        CHECK(p[3 * i] / depth / tan_x == doctest::Approx(2 * uv[2 * i] - 1).epsilon(1e-5));
        CHECK(p[3 * i + 1] / depth / tan_y == doctest::Approx(1 - 2 * uv[2 * i + 1]).epsilon(1e-5));
      }
    }
    CHECK(farthest <= 1.3 + 1e-5);
    CHECK(farthest > 1.2);
  }
}

TEST_CASE("In a GLB, triangles face the camera and go from far to near") {
  const slide::Camera camera = slide::make_camera(48, 32);
  const Glb glb = parse(slide::encode_glb(sample_scene(48, 32), camera, {.depth = slide::GlbDepth::kTrue}));
  for (const Json& mesh : glb.json["meshes"]) {
    const Json& primitive = mesh["primitives"][0];
    const std::vector<float> p = glb.values<float>(primitive["attributes"]["POSITION"]);
    const auto indices = glb.values<std::uint32_t>(primitive["indices"]);
    REQUIRE(indices.size() % 3 == 0);
    double before = -1;
    double area = 0;
    for (std::size_t i = 0; i < indices.size(); i += 3) {
      double nearness = 0;
      double x[3];
      double y[3];
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t v = indices[i + k];
        REQUIRE(v < p.size() / 3);
        const double depth = -p[3 * v + 2];
        x[k] = p[3 * v] / depth;
        y[k] = p[3 * v + 1] / depth;
        nearness += 1 / depth;
      }
      const double cross = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
      CHECK(cross > 0);  // counter-clockwise with y up
      area += cross / 2;
      CHECK(nearness >= before - 1e-5);
      before = nearness;
    }
    const double width = 48 / camera.focal;
    const double height = 32 / camera.focal;
    CHECK(area == doctest::Approx(width * height).epsilon(1e-5));  // the whole photo, once
  }
}

TEST_CASE(
    "In a GLB, the foreground blends with a texture that holds its visibility, the background is opaque") {
  const slide::Layers scene = sample_scene(48, 32);
  const Glb glb = parse(slide::encode_glb(scene, slide::make_camera(48, 32)));
  const Json& materials = glb.json["materials"];
  REQUIRE(materials.size() == 2);
  CHECK(materials[0]["name"] == "background");
  CHECK_FALSE(materials[0].contains("alphaMode"));
  CHECK(materials[1]["alphaMode"] == "BLEND");
  const DecodedPng texture = independent_png(glb.image(1));
  REQUIRE(texture.channels == 4);
  for (int y = 0; y < 32; ++y) {
    for (int x = 0; x < 48; ++x) {
      const auto i = static_cast<std::size_t>((y * 48 + x) * 4);
      CHECK(texture.samples[i + 3] == std::lround(scene.foreground.alpha.at(x, y) * 255));
      CHECK(texture.samples[i] == std::lround(scene.foreground.colour.at(x, y) * 255));
    }
  }
  CHECK(glb.json["images"][0]["mimeType"] == "image/jpeg");
  CHECK(slide::decode_photo(glb.image(0), "background").colour.width == 48);
}

TEST_CASE("A GLB of a single layer is opaque, and a mesh without tolerance keeps every vertex") {
  slide::Layers layers;
  layers.foreground = sample_scene(48, 32).foreground;
  slide::GltfOptions options;
  options.mesh_tolerance = 0;
  const Glb glb = parse(slide::encode_glb(layers, slide::make_camera(48, 32), options));
  REQUIRE(glb.json["meshes"].size() == 1);
  CHECK_FALSE(glb.json["materials"][0].contains("alphaMode"));
  const Json& primitive = glb.json["meshes"][0]["primitives"][0];
  CHECK(glb.json["accessors"][primitive["attributes"]["POSITION"].get<std::size_t>()]["count"] == 50 * 34);
  layers.foreground.disparity.at(3, 3) = std::nanf("");
  CHECK_THROWS_AS(static_cast<void>(slide::encode_glb(layers, slide::make_camera(48, 32))), slide::Error);
}
