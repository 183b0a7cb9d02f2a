#include "benchmarks/eval/stereo_scene.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>

#include "render/image_file.h"
#include "runtime/error.h"

namespace slide::eval {
namespace {

constexpr double kJump = 1.0;  ///< pixels of disparity between neighbours of one surface, at most

/// The smaller one of the nearest known values to both sides; rows without any stay as they are.
bool fill_row(const Image& known, Image& disparity, int y) {
  const int width = disparity.width;
  constexpr float kNone = std::numeric_limits<float>::infinity();
  std::vector<float> from_left(static_cast<std::size_t>(width));
  float last = kNone;
  for (int x = 0; x < width; ++x) {
    if (known.at(x, y) > 0) last = disparity.at(x, y);
    from_left[static_cast<std::size_t>(x)] = last;
  }
  if (last == kNone) return false;
  last = kNone;
  for (int x = width - 1; x >= 0; --x) {
    if (known.at(x, y) > 0) last = disparity.at(x, y);
    disparity.at(x, y) = std::min(last, from_left[static_cast<std::size_t>(x)]);
  }
  return true;
}

void fill_unknown(StereoScene& scene) {
  Image& d = scene.disparity;
  int good = -1;
  for (int y = 0; y < d.height; ++y) {
    if (fill_row(scene.known, d, y)) {
      if (good < 0)
        for (int above = 0; above < y; ++above) std::copy_n(d.row(y), d.width, d.row(above));
      good = y;
    } else if (good >= 0) {
      std::copy_n(d.row(good), d.width, d.row(y));
    }
  }
  if (good < 0) throw Error(ErrorKind::kBadInput, scene.name + ": no disparity is known");
}

/// The pixel columns that lie in [from, to].
struct Columns {
  int first, last;
};
Columns columns(double from, double to, int width) {
  return {std::max(0, static_cast<int>(std::ceil(from))),
          std::min(width - 1, static_cast<int>(std::floor(to)))};
}

}  // namespace

StereoScene read_stereo_scene(const std::string& folder) try {
  const auto bytes = read_file(folder + "/scene.json");
  const auto json = nlohmann::json::parse(bytes.begin(), bytes.end());
  StereoScene scene;
  scene.name = std::filesystem::path(folder).filename().string();
  const auto path = [&](const char* key) { return folder + "/" + json.at(key).get<std::string>(); };
  scene.left = read_photo(path("source_image")).colour;
  scene.right = read_photo(path("target_image")).colour;
  scene.disparity = read_map(path("disparity"));
  const auto same_size = [&](const Image& a) {
    return a.width == scene.left.width && a.height == scene.left.height;
  };
  if (!same_size(scene.right) || !same_size(scene.disparity))
    throw Error(ErrorKind::kBadInput, folder + ": the pictures differ in size");
  // The map came as 16-bit values over 65535.
  const double scale = 65535.0 * json.at("disparity_scale").get<double>();
  const double unknown = json.at("unknown").get<double>();
  scene.known = Image(scene.left.width, scene.left.height, 1);
  for (std::size_t i = 0; i < scene.disparity.data.size(); ++i) {
    const double stored = std::round(static_cast<double>(scene.disparity.data[i]) * 65535.0);
    scene.known.data[i] = stored == unknown ? 0.0F : 1.0F;
    scene.disparity.data[i] = static_cast<float>(static_cast<double>(scene.disparity.data[i]) * scale);
  }
  fill_unknown(scene);
  return scene;
} catch (const nlohmann::json::exception& e) {
  throw Error(ErrorKind::kBadInput, folder + "/scene.json: " + e.what());
}

StereoView stereo_view(int width, int height, const PixelRange& pixels) {
  StereoView out{make_camera(width, height, kDefaultFov, 1.0, 2.0), {}};
  const Camera& c = out.camera;
  const double tx = -pixels.range / (c.focal * (c.inverse_depth(1) - c.inverse_depth(0)));
  out.view.pose.translation.x = tx;
  out.view.shift.x = -pixels.base - c.focal * tx * c.inverse_depth(0);
  return out;
}

SeenFromRight seen_from_right(const StereoScene& scene) {
  const Image& d = scene.disparity;
  SeenFromRight out{Image(d.width, d.height, 1), Image(d.width, d.height, 1)};
  std::vector<double> nearest(static_cast<std::size_t>(d.width));
  for (int y = 0; y < d.height; ++y) {
    std::ranges::fill(nearest, 0.0);
    const auto both_known = [&](int x) { return scene.known.at(x, y) > 0 && scene.known.at(x + 1, y) > 0; };
    const auto lands = [&](int x) { return static_cast<double>(x) - static_cast<double>(d.at(x, y)); };
    const auto is_jump = [&](int x) {
      return std::fabs(static_cast<double>(d.at(x + 1, y) - d.at(x, y))) > kJump;
    };
    for (int x = 0; x + 1 < d.width; ++x) {
      if (is_jump(x)) continue;
      const Columns c = columns(lands(x), lands(x + 1), d.width);
      for (int xr = c.first; xr <= c.last; ++xr) {
        const double t = (xr - lands(x)) / std::max(lands(x + 1) - lands(x), 1e-9);
        const double here =
            static_cast<double>(d.at(x, y)) * (1 - t) + static_cast<double>(d.at(x + 1, y)) * t;
        double& best = nearest[static_cast<std::size_t>(xr)];
        if (here < best) continue;
        best = here;
        out.visible.at(xr, y) = both_known(x) ? 1.0F : 0.0F;
      }
    }
    for (int x = 0; x + 1 < d.width; ++x) {
      if (!is_jump(x) || !both_known(x)) continue;
      const Columns c = columns(lands(x), lands(x + 1), d.width);
      for (int xr = c.first; xr <= c.last; ++xr)
        if (nearest[static_cast<std::size_t>(xr)] == 0.0) out.disoccluded.at(xr, y) = 1.0F;
    }
  }
  return out;
}

}  // namespace slide::eval
