#include "render/html.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <span>
#include <string_view>
#include <vector>

#include "render/base64.h"
#include "render/camera_path.h"
#include "render/codec.h"
#include "render/viewer/viewer.h"
#include "render/write_image.h"
#include "runtime/error.h"

namespace slide {
namespace {

using Json = nlohmann::json;

std::string data_uri(const char* type, std::span<const std::uint8_t> bytes) {
  return std::string("data:") + type + ";base64," + base64(bytes);
}

/// Text for an HTML element or attribute.
std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

/// Bilinear, pixel centres at integers, the border repeated.
float sample(const Image& map, double x, double y) {
  const double cx = std::clamp(x, 0.0, map.width - 1.0);
  const double cy = std::clamp(y, 0.0, map.height - 1.0);
  const int x0 = static_cast<int>(cx);
  const int y0 = static_cast<int>(cy);
  const int x1 = std::min(x0 + 1, map.width - 1);
  const int y1 = std::min(y0 + 1, map.height - 1);
  const double fx = cx - x0;
  const double fy = cy - y0;
  const double top = (1 - fx) * map.at(x0, y0) + fx * map.at(x1, y0);
  const double bottom = (1 - fx) * map.at(x0, y1) + fx * map.at(x1, y1);
  return static_cast<float>((1 - fy) * top + fy * bottom);
}

struct Grid {
  int columns = 0;
  int rows = 0;
};

Grid grid_for(const Image& map, int mesh_side) {
  const int longer = std::max(map.width, map.height);
  const double scale = std::min(1.0, static_cast<double>(mesh_side) / longer);
  const auto vertices = [scale](int pixels) {
    return std::max(2, static_cast<int>(std::lround(pixels * scale)));
  };
  return {vertices(map.width), vertices(map.height)};
}

/// The disparity at the mesh's vertices, which lie evenly over the photo's area [-0.5, W-0.5] × [-0.5,
/// H-0.5]: its upper 8 bits in red, its lower 8 in green.
std::vector<std::uint8_t> packed_disparity(const Image& map, const Grid& grid) {
  std::vector<std::uint8_t> samples;
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      const double x = static_cast<double>(column) * (map.width - 1) / (grid.columns - 1);
      const double y = static_cast<double>(row) * (map.height - 1) / (grid.rows - 1);
      const auto v = static_cast<unsigned>(std::lround(sample(map, x, y) * 65535.0F));
      samples.push_back(static_cast<std::uint8_t>(v >> 8U));
      samples.push_back(static_cast<std::uint8_t>(v & 0xFFU));
      samples.push_back(0);
    }
  }
  return encode_png_samples(grid.columns, grid.rows, 3, 8, samples);
}

std::string colours_uri(const Layer& layer, const HtmlOptions& options) {
  return data_uri("image/jpeg", encode_jpeg(layer.colour, options.jpeg_quality));
}

/// A layer without its colours.
Json layer_json(const Layer& layer, const HtmlOptions& options, bool with_alpha) {
  const Grid grid = grid_for(layer.disparity, options.mesh_side);
  Json json = {{"disparity", data_uri("image/png", packed_disparity(layer.disparity, grid))},
               {"columns", grid.columns},
               {"rows", grid.rows}};
  if (with_alpha) json["alpha"] = data_uri("image/png", encode_png(layer.alpha, 8));
  return json;
}

void check_options(const HtmlOptions& options) {
  if (!(options.parallax_percent >= 0 && options.parallax_percent <= 50)) {
    throw Error(ErrorKind::kUsage, "the parallax must lie between 0 and 50 percent");
  }
  if (!(options.focus >= 0 && options.focus <= 1)) {
    throw Error(ErrorKind::kUsage, "the focus must lie between 0 and 1");
  }
  if (options.jpeg_quality < 1 || options.jpeg_quality > 100) {
    throw Error(ErrorKind::kUsage, "the JPEG quality must lie between 1 and 100");
  }
  if (options.mesh_side < 2 || options.mesh_side > 4096) {
    throw Error(ErrorKind::kUsage, "the viewer's mesh needs 2 to 4096 vertices a side");
  }
}

/// Puts each value in place of the first {{name}}.
std::string filled(std::string_view page, std::span<const std::array<std::string, 2>> values) {
  std::string out;
  for (const auto& [name, value] : values) {
    const std::size_t at = page.find("{{" + name + "}}");
    if (at == std::string_view::npos)
      throw Error(ErrorKind::kInternal, "the viewer has no place for " + name);
    out += page.substr(0, at);
    out += value;
    page = page.substr(at + name.size() + 4);
  }
  return out += page;
}

}  // namespace

std::string encode_html(const Layers& layers, const Camera& camera, const HtmlOptions& options) {
  check_layers(layers);
  check_options(options);
  const bool two = layers.background.has_value();
  Json scene = {
      {"width", layers.foreground.colour.width},
      {"height", layers.foreground.colour.height},
      {"near", camera.near_depth},
      {"far", camera.far_depth},
      {"parallax", parallax_pixels(options.parallax_percent, layers.foreground.colour.width,
                                   layers.foreground.colour.height)},
      {"focus", options.focus},
      {"foreground", layer_json(layers.foreground, options, two && !layers.foreground.alpha.empty())}};
  if (two) {
    scene["background"] = layer_json(*layers.background, options, false);
    scene["background"]["colour"] = colours_uri(*layers.background, options);
  }
  const std::string alt = escaped(options.alt.empty() ? options.title : options.alt);
  const std::array<std::array<std::string, 2>, 5> values = {
      {{"title", escaped(options.title)},
       {"alt", alt},
       {"still", colours_uri(layers.foreground, options)},
       {"label", alt},
       {"scene", scene.dump()}}};
  return filled(kViewerPage, values);
}

void write_html(const std::string& path, const Layers& layers, const Camera& camera,
                const HtmlOptions& options) {
  const std::string page = encode_html(layers, camera, options);
  const auto bytes = std::as_bytes(std::span(page));
  write_bytes(path, {reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
}

}  // namespace slide
