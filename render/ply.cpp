#include "render/ply.h"

#include <bit>

#include "render/codec.h"
#include "render/write_image.h"

namespace slide {
namespace {

constexpr float kVisible = 0.5F;

/// Points as the file has them.
class Points {
 public:
  explicit Points(const Camera& camera) : camera_(camera) {}

  /// The points of those pixels of a layer that `is_shown` tells.
  template <typename IsShown>
  void add(const Layer& layer, const IsShown& is_shown) {
    const std::vector<std::uint8_t> colours = to_samples(layer.colour, 8);
    for (int y = 0; y < layer.disparity.height; ++y)
      for (int x = 0; x < layer.disparity.width; ++x) {
        const std::size_t i = layer.disparity.index(x, y);
        if (!is_shown(i)) continue;
        const glm::dvec3 at = back_project(camera_, x, y, static_cast<double>(layer.disparity.data[i]));
        put(static_cast<float>(at.x));
        put(static_cast<float>(-at.y));
        put(static_cast<float>(-at.z));
        for (std::size_t c = 0; c < 3; ++c) bytes_.push_back(colours[3 * i + c]);
        ++count_;
      }
  }

  [[nodiscard]] std::vector<std::uint8_t> file() const {
    const std::string header =
        "ply\nformat binary_little_endian 1.0\ncomment SLIDE 3D photo\nelement vertex " +
        std::to_string(count_) +
        "\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
        "property uchar blue\nend_header\n";
    std::vector<std::uint8_t> out(header.begin(), header.end());
    out.insert(out.end(), bytes_.begin(), bytes_.end());
    return out;
  }

 private:
  void put(float value) {
    const auto bits = std::bit_cast<std::uint32_t>(value);
    for (unsigned shift = 0; shift < 32; shift += 8)
      bytes_.push_back(static_cast<std::uint8_t>(bits >> shift & 0xFFU));
  }

  const Camera& camera_;
  std::vector<std::uint8_t> bytes_;
  std::size_t count_ = 0;
};

}  // namespace

std::vector<std::uint8_t> encode_ply(const Layers& layers, const Camera& camera) {
  check_layers(layers);
  const Layer& front = layers.foreground;
  const auto visible = [&front](std::size_t i) {
    return front.alpha.empty() || front.alpha.data[i] >= kVisible;
  };
  Points points(camera);
  points.add(front, visible);
  if (layers.background)
    points.add(*layers.background, [&](std::size_t i) {
      return !visible(i) || layers.background->disparity.data[i] != front.disparity.data[i];
    });
  return points.file();
}

void write_ply(const std::string& path, const Layers& layers, const Camera& camera) {
  write_bytes(path, encode_ply(layers, camera));
}

}  // namespace slide
