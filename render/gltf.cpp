#include "render/gltf.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <numbers>
#include <numeric>
#include <span>

#include "render/codec.h"
#include "render/mesh.h"
#include "render/write_image.h"

namespace slide {
namespace {

using Json = nlohmann::json;

static_assert(std::endian::native == std::endian::little, "glTF buffers are little-endian");

constexpr int kFloat = 5126;
constexpr int kUnsignedInt = 5125;
constexpr int kVertexTarget = 34962;
constexpr int kIndexTarget = 34963;
constexpr int kTriangles = 4;
constexpr int kLinear = 9729;
constexpr int kLinearMipmapLinear = 9987;
constexpr int kClampToEdge = 33071;
constexpr int kJpegQuality = 92;

constexpr double kReliefDepth = 1.3;  // of the farthest point, where the nearest has 1
constexpr double kReliefFov = 40;     // degrees, of the longer side

/// Where the scene stands: what the camera sees, its distance from the origin, and the scale of both.
struct Placement {
  Camera camera;
  double distance = 0;
  double scale = 1;
};

Placement relief(const Camera& camera, double focus) {
  const double longer = std::max(camera.width, camera.height);
  const double tangent = std::tan(kReliefFov / 2 * std::numbers::pi / 180);
  Placement p{camera, 0, 1};
  p.camera.focal = longer / 2 / tangent;
  p.camera.near_depth = 1;
  p.camera.far_depth = kReliefDepth;
  const double focus_depth = 1 / p.camera.inverse_depth(focus);
  p.scale = 1 / (2 * tangent * focus_depth);
  p.distance = focus_depth * p.scale;
  return p;
}

/// The JSON document and the binary buffer it speaks of, growing together.
class GlbBuilder {
 public:
  GlbBuilder();

  /// Both return the index of what they added.
  int add_mesh(const Mesh& mesh, const Placement& placement, int material, const std::string& name);
  int add_material(const Layer& layer, bool transparent, const std::string& name);
  void add_node(Json node) {
    doc_["scenes"][0]["nodes"].push_back(doc_["nodes"].size());
    doc_["nodes"].push_back(std::move(node));
  }
  void add_camera(const Placement& placement);
  [[nodiscard]] std::vector<std::uint8_t> finish();

 private:
  int add_view(std::span<const std::uint8_t> bytes, int target);
  int add_accessor(int view, int component, std::size_t count, const char* type);
  template <std::size_t N>
  int add_vectors(const std::vector<std::array<float, N>>& values, const char* type);

  Json doc_;
  std::vector<std::uint8_t> buffer_;
};

GlbBuilder::GlbBuilder() {
  doc_["asset"] = {{"version", "2.0"}, {"generator", "SLIDE 3D photo"}};
  doc_["extensionsUsed"] = {"KHR_materials_unlit"};
  doc_["scene"] = 0;
  doc_["scenes"] = Json::array({{{"nodes", Json::array()}}});
  doc_["samplers"] = Json::array({{{"magFilter", kLinear},
                                   {"minFilter", kLinearMipmapLinear},
                                   {"wrapS", kClampToEdge},
                                   {"wrapT", kClampToEdge}}});
  for (const char* list :
       {"nodes", "meshes", "materials", "textures", "images", "accessors", "bufferViews"}) {
    doc_[list] = Json::array();
  }
}

int GlbBuilder::add_view(std::span<const std::uint8_t> bytes, int target) {
  buffer_.resize((buffer_.size() + 3) / 4 * 4, 0);
  Json view = {{"buffer", 0}, {"byteOffset", buffer_.size()}, {"byteLength", bytes.size()}};
  if (target != 0) view["target"] = target;
  buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
  doc_["bufferViews"].push_back(std::move(view));
  return static_cast<int>(doc_["bufferViews"].size()) - 1;
}

int GlbBuilder::add_accessor(int view, int component, std::size_t count, const char* type) {
  doc_["accessors"].push_back(
      {{"bufferView", view}, {"componentType", component}, {"count", count}, {"type", type}});
  return static_cast<int>(doc_["accessors"].size()) - 1;
}

std::span<const std::uint8_t> bytes_of(const void* data, std::size_t size) {
  return {static_cast<const std::uint8_t*>(data), size};
}

template <std::size_t N>
int GlbBuilder::add_vectors(const std::vector<std::array<float, N>>& values, const char* type) {
  const int view = add_view(bytes_of(values.data(), values.size() * sizeof(values[0])), kVertexTarget);
  const int accessor = add_accessor(view, kFloat, values.size(), type);
  std::array<float, N> low = values[0];
  std::array<float, N> high = values[0];
  for (const auto& v : values) {
    for (std::size_t c = 0; c < N; ++c) {
      low[c] = std::min(low[c], v[c]);
      high[c] = std::max(high[c], v[c]);
    }
  }
  doc_["accessors"].back()["min"] = low;
  doc_["accessors"].back()["max"] = high;
  return accessor;
}

/// The triangles from far to near, turned the other way round: glTF's front faces turn counter-clockwise.
std::vector<std::array<std::uint32_t, 3>> sorted_triangles(const Mesh& mesh) {
  const std::size_t n = mesh.triangle_count();
  std::vector<std::array<std::uint32_t, 3>> triangles(n);
  std::vector<float> nearness(n);
  for (std::size_t i = 0; i < n; ++i) {
    const auto [a, b, c] = mesh.triangle(i);
    triangles[i] = {a, c, b};
    nearness[i] = mesh.disparity[a] + mesh.disparity[b] + mesh.disparity[c];
  }
  std::vector<std::uint32_t> order(n);
  std::iota(order.begin(), order.end(), 0U);
  std::stable_sort(order.begin(), order.end(),
                   [&nearness](std::uint32_t a, std::uint32_t b) { return nearness[a] < nearness[b]; });
  std::vector<std::array<std::uint32_t, 3>> sorted(n);
  for (std::size_t i = 0; i < n; ++i) sorted[i] = triangles[order[i]];
  return sorted;
}

int GlbBuilder::add_mesh(const Mesh& mesh, const Placement& placement, int material,
                         const std::string& name) {
  std::vector<std::array<float, 3>> positions(mesh.u.size());
  std::vector<std::array<float, 2>> texcoords(mesh.u.size());
  for (std::size_t i = 0; i < mesh.u.size(); ++i) {
    const glm::dvec3 p =
        placement.scale * back_project(placement.camera, mesh.u[i], mesh.v[i], mesh.disparity[i]);
    positions[i] = {static_cast<float>(p.x), static_cast<float>(-p.y),
                    static_cast<float>(placement.distance - p.z)};
    texcoords[i] = {(mesh.u[i] + 0.5F) / static_cast<float>(mesh.width),
                    (mesh.v[i] + 0.5F) / static_cast<float>(mesh.height)};
  }
  const auto triangles = sorted_triangles(mesh);
  const int position = add_vectors(positions, "VEC3");
  const int texcoord = add_vectors(texcoords, "VEC2");
  const int view =
      add_view(bytes_of(triangles.data(), triangles.size() * sizeof(triangles[0])), kIndexTarget);
  const int indices = add_accessor(view, kUnsignedInt, 3 * triangles.size(), "SCALAR");
  const Json primitive = {{"attributes", {{"POSITION", position}, {"TEXCOORD_0", texcoord}}},
                          {"indices", indices},
                          {"material", material},
                          {"mode", kTriangles}};
  doc_["meshes"].push_back({{"name", name}, {"primitives", Json::array({primitive})}});
  return static_cast<int>(doc_["meshes"].size()) - 1;
}

/// Colour and alpha in one image.
Image with_alpha(const Layer& layer) {
  Image out(layer.colour.width, layer.colour.height, 4);
  for (std::size_t i = 0; i < out.pixels(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) out.data[4 * i + c] = layer.colour.data[3 * i + c];
    out.data[4 * i + 3] = layer.alpha.data[i];
  }
  return out;
}

int GlbBuilder::add_material(const Layer& layer, bool transparent, const std::string& name) {
  const std::vector<std::uint8_t> image =
      transparent ? encode_png(with_alpha(layer), 8) : encode_jpeg(layer.colour, kJpegQuality);
  doc_["images"].push_back(
      {{"bufferView", add_view(image, 0)}, {"mimeType", transparent ? "image/png" : "image/jpeg"}});
  doc_["textures"].push_back({{"source", doc_["images"].size() - 1}, {"sampler", 0}});
  Json material = {{"name", name},
                   {"doubleSided", true},
                   {"pbrMetallicRoughness",
                    {{"baseColorTexture", {{"index", doc_["textures"].size() - 1}}},
                     {"metallicFactor", 0.0},
                     {"roughnessFactor", 1.0}}},
                   {"extensions", {{"KHR_materials_unlit", Json::object()}}}};
  if (transparent) material["alphaMode"] = "BLEND";
  doc_["materials"].push_back(std::move(material));
  return static_cast<int>(doc_["materials"].size()) - 1;
}

void GlbBuilder::add_camera(const Placement& placement) {
  const Camera& camera = placement.camera;
  const Json perspective = {{"aspectRatio", static_cast<double>(camera.width) / camera.height},
                            {"yfov", 2 * std::atan(camera.height / 2.0 / camera.focal)},
                            {"znear", placement.scale * camera.clip_depth()},
                            {"zfar", placement.scale * 2 * camera.far_depth}};
  doc_["cameras"] = Json::array({{{"name", "photo"}, {"type", "perspective"}, {"perspective", perspective}}});
  add_node({{"name", "camera"}, {"camera", 0}, {"translation", {0.0, 0.0, placement.distance}}});
}

void put_u32(std::vector<std::uint8_t>& out, std::size_t value) {
  for (unsigned shift = 0; shift < 32; shift += 8)
    out.push_back(static_cast<std::uint8_t>(value >> shift & 0xFFU));
}

std::vector<std::uint8_t> GlbBuilder::finish() {
  constexpr std::size_t kHeaderBytes = 12;
  constexpr std::size_t kChunkHeaderBytes = 8;
  buffer_.resize((buffer_.size() + 3) / 4 * 4, 0);
  doc_["buffers"] = Json::array({{{"byteLength", buffer_.size()}}});
  std::string json = doc_.dump();
  json.resize((json.size() + 3) / 4 * 4, ' ');
  std::vector<std::uint8_t> out = {'g', 'l', 'T', 'F', 2, 0, 0, 0};
  put_u32(out, kHeaderBytes + 2 * kChunkHeaderBytes + json.size() + buffer_.size());
  put_u32(out, json.size());
  out.insert(out.end(), {'J', 'S', 'O', 'N'});
  out.insert(out.end(), json.begin(), json.end());
  put_u32(out, buffer_.size());
  out.insert(out.end(), {'B', 'I', 'N', 0});
  out.insert(out.end(), buffer_.begin(), buffer_.end());
  return out;
}

}  // namespace

std::vector<std::uint8_t> encode_glb(const Layers& layers, const Camera& camera, const GltfOptions& options) {
  constexpr double kDefaultParallax = 0.04;
  check_layers(layers);
  const double parallax = options.parallax > 0 ? options.parallax : kDefaultParallax * camera.width;
  const auto mesh_of = [&](const Layer& layer) {
    return options.mesh_tolerance > 0 ? adaptive_mesh(layer.disparity, options.mesh_tolerance / parallax)
                                      : full_mesh(layer.disparity);
  };
  GlbBuilder glb;
  const Placement placement =
      options.depth == GlbDepth::kTrue ? Placement{camera} : relief(camera, options.focus);
  glb.add_camera(placement);
  const auto add_layer = [&](const Layer& layer, bool transparent, const std::string& name) {
    const int material = glb.add_material(layer, transparent, name);
    glb.add_node({{"name", name}, {"mesh", glb.add_mesh(mesh_of(layer), placement, material, name)}});
  };
  if (layers.background) add_layer(*layers.background, false, "background");
  add_layer(layers.foreground, layers.background && !layers.foreground.alpha.empty(), "foreground");
  return glb.finish();
}

void write_glb(const std::string& path, const Layers& layers, const Camera& camera,
               const GltfOptions& options) {
  write_bytes(path, encode_glb(layers, camera, options));
}

}  // namespace slide
