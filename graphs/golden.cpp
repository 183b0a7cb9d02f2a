#include "graphs/golden.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "graphs/catalogue.h"
#include "runtime/error.h"

namespace slide::graphs {
namespace {

/// "output.3" with prefix "output." gives "3".
std::optional<std::string> after(std::string_view prefix, const std::string& name) {
  if (!name.starts_with(prefix)) return std::nullopt;
  return name.substr(prefix.size());
}

Error bad_golden(const SafetensorsFile& file, const std::string& problem) {
  return {ErrorKind::kBadInput, file.description() + ": " + problem};
}

std::map<std::string, std::int64_t, std::less<>> read_strides(const SafetensorsFile& file) {
  std::map<std::string, std::int64_t, std::less<>> strides;
  const auto text = file.metadata().find("strides");
  if (text == file.metadata().end()) return strides;
  const auto json = nlohmann::json::parse(text->second, nullptr, false);
  if (!json.is_object()) throw bad_golden(file, "the metadata \"strides\" is no JSON object");
  for (const auto& [name, stride] : json.items()) {
    if (!stride.is_number_integer() || stride.get<std::int64_t>() < 1)
      throw bad_golden(file, "the stride of " + name + " is no positive integer");
    strides[name] = stride.get<std::int64_t>();
  }
  return strides;
}

double difference(double a, double b) {
  if (std::isnan(a) || std::isnan(b))
    return std::isnan(a) && std::isnan(b) ? 0 : std::numeric_limits<double>::infinity();
  return a == b ? 0 : std::abs(a - b);
}

}  // namespace

Golden::Golden(SafetensorsFile file) : file_(std::move(file)), strides_(read_strides(file_)) {
  const auto network = file_.metadata().find("network");
  if (network == file_.metadata().end())
    throw bad_golden(file_, "the metadata \"network\" of a golden file is missing");
  network_ = network->second;
}

std::unique_ptr<Graph> Golden::build(const WeightSource& weights) const {
  BuildOptions options{.weights = &weights, .weights_as_used = true};
  for (const TensorInfo& info : file_.tensors()) {
    if (!info.name.starts_with("input.")) continue;
    if (info.shape.rank() < 2) throw bad_golden(file_, info.name + " has shape " + info.shape.text());
    options.height = info.shape[-2];
    options.width = info.shape[-1];
  }
  std::unique_ptr<Graph> graph = build_model(network_, options);
  for (const TensorInfo& info : file_.tensors()) {
    if (const auto tap = after("tap.", info.name); tap && !graph->taps().contains(*tap))
      throw bad_golden(file_, "the network " + network_ + " has no module named " + *tap);
    const auto output = after("output.", info.name);
    if (output && std::ranges::none_of(graph->outputs(), [&](const auto& o) { return o.first == *output; }))
      throw bad_golden(file_, "the network " + network_ + " has no output " + *output);
  }
  return graph;
}

NamedTensors Golden::inputs(const Graph& graph) const {
  NamedTensors inputs;
  for (const Node& node : graph.nodes()) {
    if (node.kind != NodeKind::kInput) continue;
    const std::string name = "input." + node.name;
    if (!file_.contains(name)) throw bad_golden(file_, "the network's input " + node.name + " is missing");
    const Tensor stored = file_.tensor(name);
    if (stored.count() != node.shape.count())
      throw bad_golden(
          file_, name + " has shape " + stored.shape().text() + ", the network needs " + node.shape.text());
    inputs[node.name] = stored.reshaped(node.shape);
  }
  return inputs;
}

std::set<std::string> Golden::taps() const {
  std::set<std::string> names;
  for (const TensorInfo& info : file_.tensors())
    if (const auto tap = after("tap.", info.name)) names.insert(*tap);
  return names;
}

std::vector<GoldenError> Golden::compare(const std::function<Tensor(const std::string&)>& result) const {
  std::vector<GoldenError> errors;
  for (const TensorInfo& info : file_.tensors()) {
    const auto output = after("output.", info.name);
    const auto name = output ? output : after("tap.", info.name);
    if (!name) continue;
    errors.push_back(compare_tensor(info, *name, result(*name)));
    errors.back().output = output.has_value();
  }
  return errors;
}

GoldenError Golden::compare_tensor(const TensorInfo& stored, const std::string& name,
                                   const Tensor& result) const {
  const auto known = strides_.find(stored.name);
  const std::int64_t stride = known == strides_.end() ? 1 : known->second;
  if ((result.count() + stride - 1) / stride != stored.shape.count())
    throw bad_golden(file_, stored.name + " has shape " + stored.shape.text() + " and stands for every " +
                                std::to_string(stride) + "th element, the network's result has shape " +
                                result.shape().text());
  const Tensor wide = file_.tensor(stored.name).to(DType::kF64);
  const Tensor own = result.to(DType::kF64);
  const std::span<const double> expected = wide.data<double>();
  const std::span<const double> got = own.data<double>();
  GoldenError error{.name = name, .magnitude = max_abs(wide)};
  for (std::size_t i = 0; i < expected.size(); ++i)
    error.error = std::max(error.error, difference(expected[i], got[i * static_cast<std::size_t>(stride)]));
  if (error.magnitude > 0) error.error /= error.magnitude;
  return error;
}

}  // namespace slide::graphs
