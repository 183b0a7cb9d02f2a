#include "render/embedded_depth.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>

#include "render/base64.h"
#include "render/codec.h"
#include "render/xmp.h"
#include "runtime/error.h"

namespace slide {
namespace {

using Bytes = std::span<const std::uint8_t>;

[[noreturn]] void broken(const std::string& name, const std::string& what) {
  throw Error(ErrorKind::kBadInput, name + ": the depth map in it cannot be used: " + what,
              "give one with --depth FILE, or leave --depth out");
}

bool is_picture(Bytes bytes) { return is_jpeg(bytes) || is_png(bytes); }

/// A positive number; 0 where there is none.
double positive_number(std::string_view text) {
  double value = 0;
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), value);
  return failure == std::errc() && end == text.data() + text.size() && std::isfinite(value) && value > 0
             ? value
             : 0;
}

/// What GDepth and Dynamic Depth say alike, under their own prefix.
EmbeddedDepth described(std::string_view xmp, const std::string& prefix, const std::string& name) {
  EmbeddedDepth depth;
  const std::string_view format = xmp_property(xmp, prefix + "Format");
  depth.inverse = format.empty() || format == "RangeInverse";
  if (!depth.inverse && format != "RangeLinear")
    broken(name, "its format is " + std::string(format.substr(0, 40)));
  depth.near = positive_number(xmp_property(xmp, prefix + "Near"));
  depth.far = positive_number(xmp_property(xmp, prefix + "Far"));
  return depth;
}

/// An entry of Container:Directory.
struct Item {
  std::string_view uri, semantic;
  std::size_t length = 0, padding = 0;
};

std::size_t count_of(std::string_view text) {
  std::size_t value = 0;
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

std::vector<Item> items_of(std::string_view xmp) {
  constexpr std::string_view kEntry = "<rdf:li";
  const std::size_t begin = xmp.find("<Container:Directory");
  if (begin == std::string_view::npos) return {};
  xmp = xmp.substr(begin, xmp.find("</Container:Directory", begin) - begin);
  std::vector<Item> items;
  for (std::size_t at = xmp.find(kEntry); at != std::string_view::npos;) {
    const std::size_t next = xmp.find(kEntry, at + 1);
    const std::string_view entry = xmp.substr(at, next - at);
    items.push_back({xmp_property(entry, "Item:DataURI"), xmp_property(entry, "Item:Semantic"),
                     count_of(xmp_property(entry, "Item:Length")),
                     count_of(xmp_property(entry, "Item:Padding"))});
    at = next;
  }
  return items;
}

/// `length` bytes from `begin` on, if they are there and begin a picture; else empty.
Bytes picture_at(Bytes file, std::size_t begin, std::size_t length) {
  if (begin > file.size() || length > file.size() - begin) return {};
  const Bytes part = file.subspan(begin, length);
  return is_picture(part) ? part : Bytes();
}

/// The item that holds the map: items follow the photo without a gap, but for its padding; where something
/// else lies between, they still end the file.
Bytes find_item(Bytes jpeg, const std::vector<Item>& items, std::string_view uri, const std::string& name) {
  std::size_t before = 0;  // bytes of items between the photo and the map
  std::size_t from_map = 0;
  const Item* map = nullptr;
  for (std::size_t i = 1; i < items.size(); ++i) {
    const Item& item = items[i];
    if (item.length > jpeg.size() || item.padding > jpeg.size())
      broken(name, "its directory tells of more bytes than there are");
    if (map == nullptr && (item.uri.empty() ? item.semantic == "Depth" : item.uri == uri)) map = &item;
    (map == nullptr ? before : from_map) += item.length + item.padding;
    if (before > jpeg.size() || from_map > jpeg.size())
      broken(name, "its directory tells of more bytes than there are");
  }
  if (map == nullptr || map->length == 0) broken(name, "its directory has no entry for it");
  const std::size_t padding = std::min(items[0].padding, jpeg.size());
  Bytes found = picture_at(jpeg, jpeg_picture_bytes(jpeg) + padding + before, map->length);
  if (found.empty()) found = picture_at(jpeg, jpeg.size() - from_map, map->length);
  if (found.empty()) broken(name, "there is no picture where its directory says");
  return found;
}

}  // namespace

bool has_embedded_depth(Bytes jpeg) {
  if (!is_jpeg(jpeg)) return false;
  const std::string xmp = xmp_of_jpeg(jpeg);
  return !xmp_property(xmp, "GDepth:Data").empty() || !xmp_property(xmp, "DepthMap:DepthURI").empty();
}

std::optional<EmbeddedDepth> find_embedded_depth(Bytes jpeg, const std::string& name) {
  if (!is_jpeg(jpeg)) return std::nullopt;
  const std::string xmp = xmp_of_jpeg(jpeg);
  if (const std::string_view data = xmp_property(xmp, "GDepth:Data"); !data.empty()) {
    EmbeddedDepth depth = described(xmp, "GDepth:", name);
    std::optional<std::vector<std::uint8_t>> file = bytes_of_base64(data);
    if (!file || !is_picture(*file)) broken(name, "it is neither JPEG nor PNG");
    depth.file = std::move(*file);
    return depth;
  }
  const std::string_view uri = xmp_property(xmp, "DepthMap:DepthURI");
  if (uri.empty()) return std::nullopt;
  EmbeddedDepth depth = described(xmp, "DepthMap:", name);
  const Bytes file = find_item(jpeg, items_of(xmp), uri, name);
  depth.file.assign(file.begin(), file.end());
  return depth;
}

Image disparity_of(const EmbeddedDepth& depth, Image map, const std::string& name) {
  if (depth.inverse) {
    // Near and far only tell which end is near, and some files have them the other way round.
    const bool white_is_near = depth.near > 0 && depth.far > 0 && depth.near > depth.far;
    for (float& v : map.data) v = white_is_near ? v : 1 - v;
    return map;
  }
  if (!(depth.near > 0 && depth.far > depth.near))
    broken(name, "a map of the kind RangeLinear needs Near and Far, 0 < Near < Far");
  for (float& v : map.data)
    v = static_cast<float>(1 / (depth.near + static_cast<double>(v) * (depth.far - depth.near)));
  return map;
}

}  // namespace slide
