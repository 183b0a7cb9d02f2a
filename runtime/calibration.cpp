#include "runtime/calibration.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "runtime/error.h"

namespace slide {
namespace {

using Json = nlohmann::json;

constexpr int kVersion = 1;

[[noreturn]] void refuse(const std::string& source, const std::string& what) {
  throw Error(ErrorKind::kBadWeights, source + ": the calibration in the metadata " + what,
              "calibrate again: slide_convert --calibrate");
}

/// The first parameter of a filter among a node and what it is computed from; "" for none.
std::string filter_of(const Graph& graph, int index, std::set<int>& seen) {
  if (!seen.insert(index).second) return "";
  const Node& node = graph.node(index);
  if (node.kind == NodeKind::kParameter) return node.shape.rank() >= 2 ? node.name : "";
  for (const int j : node.inputs)
    if (std::string name = filter_of(graph, j, seen); !name.empty()) return name;
  return "";
}

const Json& member(const Json& object, const char* name, const std::string& source,
                   const std::string& layer) {
  const auto it = object.find(name);
  if (it == object.end()) refuse(source, layer + "has no " + name);
  return *it;
}

/// A finite number that a float can hold.
double number(const Json& value, const std::string& source, const std::string& layer) {
  const double v = value.is_number() ? value.get<double>() : NAN;
  if (!std::isfinite(static_cast<float>(v))) refuse(source, layer + "holds something that is no number");
  return v;
}

LayerCalibration parse_layer(const Json& entry, const std::string& source, const std::string& name) {
  const std::string layer = "of layer " + name + " ";
  if (!entry.is_object()) refuse(source, layer + "is no object");
  const Json& range = member(entry, "range", source, layer);
  if (!range.is_array() || range.size() != 2) refuse(source, layer + "has a range that is no pair");
  const double low = number(range[0], source, layer);
  const double high = number(range[1], source, layer);
  if (!(low <= 0 && high >= 0 && low < high)) refuse(source, layer + "has a range that does not hold zero");
  const double error = number(member(entry, "error", source, layer), source, layer);
  if (error < 0) refuse(source, layer + "has a negative error");
  return {{static_cast<float>(low), static_cast<float>(high)}, error};
}

}  // namespace

const LayerCalibration* Calibration::find(const Graph& graph, int node) const {
  const auto it = layers.find(calibration_key(graph, node));
  return it != layers.end() ? &it->second : nullptr;
}

std::string calibration_key(const Graph& graph, int node) {
  const std::vector<int>& inputs = graph.node(node).inputs;
  std::set<int> seen;
  return inputs.size() < 2 ? "" : filter_of(graph, inputs[1], seen);
}

std::string text_of(const Calibration& calibration) {
  Json layers = Json::object();
  for (const auto& [name, layer] : calibration.layers)
    layers[name] = {{"range", {layer.range.low, layer.range.high}}, {"error", layer.error}};
  return Json{{"version", kVersion}, {"layers", layers}}.dump();
}

Calibration parse_calibration(std::string_view text, const std::string& source) {
  const Json root = Json::parse(text, nullptr, false);
  if (!root.is_object()) refuse(source, "is no JSON object");
  const Json& version = member(root, "version", source, "");
  if (!version.is_number_integer() || version != kVersion)
    refuse(source, "has a version that this program does not know");
  const Json& layers = member(root, "layers", source, "");
  if (!layers.is_object()) refuse(source, "lists no layers");
  Calibration calibration;
  for (const auto& [name, entry] : layers.items())
    calibration.layers.emplace(name, parse_layer(entry, source, name));
  return calibration;
}

}  // namespace slide
