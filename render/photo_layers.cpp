#include "render/photo_layers.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "render/cutout.h"
#include "render/oiio.h"
#include "render/write_image.h"
#include "runtime/error.h"
#include "runtime/threads.h"

namespace slide {
namespace {

constexpr double kAspectTolerance = 0.06;  // networks round sides to multiples of 64

void require_same_aspect(const Image& map, int width, int height, const std::string& name) {
  const double ratio = static_cast<double>(map.width) * height / (static_cast<double>(map.height) * width);
  const double lying = static_cast<double>(map.height) * height / (static_cast<double>(map.width) * width);
  if (std::fabs(std::log(ratio)) > kAspectTolerance && std::fabs(std::log(lying)) <= kAspectTolerance)
    throw Error(ErrorKind::kBadInput,
                name + " lies on its side: it has " + std::to_string(map.width) + "x" +
                    std::to_string(map.height) + " pixels, the photo " + std::to_string(width) + "x" +
                    std::to_string(height),
                "turn it by a quarter");
  if (std::fabs(std::log(ratio)) > kAspectTolerance)
    throw Error(ErrorKind::kBadInput,
                name + " has " + std::to_string(map.width) + "x" + std::to_string(map.height) +
                    " pixels, the photo has the shape of " + std::to_string(width) + "x" +
                    std::to_string(height),
                "give a map of the whole photo");
}

/// Where output pixel i of n reads an input of m pixels, pixel centres at half-integers: two neighbours and
/// the weight of the second.
struct Sample {
  int first, second;
  float weight;
};

Sample sample(int i, int n, int m) {
  const double at = std::clamp((i + 0.5) * m / n - 0.5, 0.0, m - 1.0);
  const int first = static_cast<int>(at);
  return {first, std::min(first + 1, m - 1), static_cast<float>(at - first)};
}

Image resized(const Image& map, int width, int height) {
  if (map.width == width && map.height == height) return map;
  Image out(width, height, 1);
  parallel_for(height, [&](std::int64_t row) {
    const int y = static_cast<int>(row);
    const Sample v = sample(y, height, map.height);
    for (int x = 0; x < width; ++x) {
      const Sample h = sample(x, width, map.width);
      // In double: values may lie at both ends of float's range.
      const auto between = [](double a, double b, float weight) { return a + weight * (b - a); };
      const double top = between(map.at(h.first, v.first), map.at(h.second, v.first), h.weight);
      const double low = between(map.at(h.first, v.second), map.at(h.second, v.second), h.weight);
      out.at(x, y) = static_cast<float>(between(top, low, v.weight));
    }
  });
  return out;
}

/// The part of input pixel j that output pixel i covers, for j from first to last: weights sum to 1.
struct Cover {
  int first;
  std::vector<double> weights;
};

std::vector<Cover> covers(int n, int m) {
  std::vector<Cover> all;
  for (int i = 0; i < n; ++i) {
    const double low = static_cast<double>(i) * m / n;
    const double high = static_cast<double>(i + 1) * m / n;
    Cover cover{static_cast<int>(low), {}};
    for (int j = cover.first; j < m && j < high; ++j)
      cover.weights.push_back((std::min(high, j + 1.0) - std::max(low, static_cast<double>(j))) /
                              (high - low));
    all.push_back(std::move(cover));
  }
  return all;
}

bool is_missing(float value, DepthKind kind) {
  return std::isnan(value) || (kind == DepthKind::kDepth && value == 0);
}

/// The disparity that a value that is not missing stands for.
float disparity_of_value(const Image& map, std::size_t i, DepthKind kind, const std::string& name) {
  const float v = map.data[i];
  const bool depth = kind == DepthKind::kDepth;
  if (depth ? v < 0 : std::isinf(v)) {
    const std::size_t width = static_cast<std::size_t>(map.width);
    throw Error(ErrorKind::kBadInput,
                name + ": the " + (depth ? "depth" : "disparity") + " at pixel (" +
                    std::to_string(i % width) + ", " + std::to_string(i / width) + ") is " +
                    (std::isinf(v) ? "infinite" : std::to_string(v)),
                depth ? "depths must be positive, 0 where they are missing; for a disparity map use "
                        "--depth-kind disparity"
                      : "replace such pixels by a value, or by NaN where there is none");
  }
  if (depth) return 1 / v;
  return kind == DepthKind::kInverted ? -v : v;
}

}  // namespace

Tensor tensor_from_image(const Image& image) {
  Tensor t(DType::kF32, {1, image.channels, image.height, image.width});
  const std::span<float> out = t.mutable_data<float>();
  const std::size_t plane = image.pixels();
  const std::size_t channels = static_cast<std::size_t>(image.channels);
  for (std::size_t i = 0; i < plane; ++i)
    for (std::size_t c = 0; c < channels; ++c) out[c * plane + i] = image.data[i * channels + c];
  return t;
}

Image image_from_tensor(const Tensor& tensor) {
  const Shape& s = tensor.shape();
  if (s.rank() != 4 || s[0] != 1)
    throw Error(ErrorKind::kInternal, "an image was made of a tensor " + s.text());
  Image image(static_cast<int>(s[3]), static_cast<int>(s[2]), static_cast<int>(s[1]));
  const std::span<const float> in = tensor.data<float>();
  const std::size_t plane = image.pixels();
  const std::size_t channels = static_cast<std::size_t>(image.channels);
  for (std::size_t i = 0; i < plane; ++i)
    for (std::size_t c = 0; c < channels; ++c) image.data[i * channels + c] = in[c * plane + i];
  return image;
}

DepthKind depth_kind(const std::string& name) {
  if (name == "disparity") return DepthKind::kDisparity;
  if (name == "depth") return DepthKind::kDepth;
  if (name == "inverted") return DepthKind::kInverted;
  throw Error(ErrorKind::kUsage, "a map cannot be of the kind " + name, "one of: disparity, depth, inverted");
}

std::size_t missing_values(const Image& map, DepthKind kind) {
  return static_cast<std::size_t>(
      std::count_if(map.data.begin(), map.data.end(), [kind](float v) { return is_missing(v, kind); }));
}

Tensor disparity_from_map(const Image& map, DepthKind kind, int width, int height, const std::string& name) {
  require_same_aspect(map, width, height, name);
  const std::size_t missing = missing_values(map, kind);
  if (missing == map.data.size())
    throw Error(ErrorKind::kBadInput, name + " holds no value: all of its pixels are 0 or not a number",
                "give a map of the whole photo");
  Image disparity(map.width, map.height, 1);
  Image known(map.width, map.height, 1, 1.0F);
  for (std::size_t i = 0; i < map.data.size(); ++i) {
    if (is_missing(map.data[i], kind))
      known.data[i] = 0;
    else
      disparity.data[i] = disparity_of_value(map, i, kind, name);
  }
  if (missing > 0) disparity = over_own_colours(disparity, known);
  return tensor_from_image(resized(disparity, width, height));
}

Tensor matte_from_map(const Image& map, int width, int height, const std::string& name) {
  require_same_aspect(map, width, height, name);
  Image matte = resized(map, width, height);
  for (float& v : matte.data) v = std::clamp(v, 0.0F, 1.0F);
  return tensor_from_image(matte);
}

Image shrink_to(const Image& image, int side) {
  const int longer = std::max(image.width, image.height);
  if (longer <= side) return image;
  const auto scaled = [&](int extent) {
    return std::max(1, static_cast<int>(std::lround(static_cast<double>(extent) * side / longer)));
  };
  Image out(scaled(image.width), scaled(image.height), image.channels);
  const std::vector<Cover> rows = covers(out.height, image.height);
  const std::vector<Cover> columns = covers(out.width, image.width);
  parallel_for(out.height, [&](std::int64_t row) {
    const int y = static_cast<int>(row);
    const Cover& v = rows[static_cast<std::size_t>(y)];
    for (int x = 0; x < out.width; ++x) {
      const Cover& h = columns[static_cast<std::size_t>(x)];
      for (int c = 0; c < image.channels; ++c) {
        double sum = 0;
        for (std::size_t j = 0; j < v.weights.size(); ++j)
          for (std::size_t i = 0; i < h.weights.size(); ++i)
            sum += v.weights[j] * h.weights[i] *
                   static_cast<double>(
                       image.at(h.first + static_cast<int>(i), v.first + static_cast<int>(j), c));
        out.at(x, y, c) = static_cast<float>(sum);
      }
    }
  });
  return out;
}

Layers layers_from(const graphs::SlideLayers& made) {
  Layers layers;
  layers.foreground = {image_from_tensor(made.front_image), image_from_tensor(made.conditioned),
                       made.has_background() ? image_from_tensor(made.visibility) : Image()};
  if (made.has_background())
    layers.background =
        Layer{image_from_tensor(made.background_image), image_from_tensor(made.background_disparity), {}};
  return layers;
}

std::vector<std::string> map_files(const std::string& folder) {
  std::vector<std::string> files = {folder + "/image.png", folder + "/background.png"};
  for (const char* name : {"D", "D1", "A", "S", "S_hat", "H", "matte", "D_bg"})
    for (const char* extension : {".png", ".pfm", ".exr"}) files.push_back(folder + "/" + name + extension);
  return files;
}

std::vector<std::string> write_maps(const std::string& folder, const graphs::SlideLayers& made) {
  std::error_code failure;
  std::filesystem::create_directories(folder, failure);
  if (failure)
    throw Error(ErrorKind::kOutput, "the folder " + folder + " cannot be made: " + failure.message());
  std::vector<std::string> files;
  const auto path = [&](const std::string& name) { return files.emplace_back(folder + "/" + name); };
  write_png(path("image.png"), image_from_tensor(made.front_image), 16);
  if (made.has_background()) write_png(path("background.png"), image_from_tensor(made.background_image), 16);
  const std::pair<const char*, const Tensor*> maps[] = {
      {"D", &made.disparity},    {"D1", &made.conditioned},           {"A", &made.visibility},
      {"S", &made.disocclusion}, {"S_hat", &made.occlusion},          {"H", &made.hole},
      {"matte", &made.matte},    {"D_bg", &made.background_disparity}};
  for (const auto& [name, map] : maps) {
    if (map->empty()) continue;
    const Image image = image_from_tensor(*map);
    write_png(path(std::string(name) + ".png"), image, 16);
    write_pfm(path(std::string(name) + ".pfm"), image);
    if (has_openimageio()) write_exr(path(std::string(name) + ".exr"), image);
  }
  return files;
}

}  // namespace slide
