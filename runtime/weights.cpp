#include "runtime/weights.h"

#include <algorithm>
#include <set>

#include "runtime/error.h"
#include "runtime/safetensors.h"

namespace slide {
namespace {

bool floating(DType type) {
  return type == DType::kF64 || type == DType::kF32 || type == DType::kF16 || type == DType::kBF16;
}

void append_list(std::string& out, std::string_view title, const std::vector<std::string>& list) {
  constexpr std::size_t kShown = 8;
  if (list.empty()) return;
  out +=
      std::string(out.empty() ? "" : "; ") + std::string(title) + " (" + std::to_string(list.size()) + "): ";
  for (std::size_t i = 0; i < std::min(kShown, list.size()); ++i) out += (i > 0 ? ", " : "") + list[i];
  if (list.size() > kShown) out += " ... and " + std::to_string(list.size() - kShown) + " more";
}

}  // namespace

void WeightSource::check(std::string_view name, const Tensor& tensor) const {
  if (const auto element = first_not_finite(tensor.dtype(), tensor.raw()))
    throw Error(ErrorKind::kBadWeights, description() + ": tensor " + std::string(name) + ": element " +
                                            std::to_string(*element) + " is not a finite number");
}

std::optional<Tensor> WeightMap::find(std::string_view name, const Shape& /*wanted*/) const {
  const auto it = tensors_.find(name);
  if (it == tensors_.end()) return std::nullopt;
  return it->second;
}

std::vector<std::string> WeightMap::names() const {
  std::vector<std::string> out;
  out.reserve(tensors_.size());
  for (const auto& entry : tensors_) out.push_back(entry.first);
  return out;
}

std::string WeightFit::message(const std::string& source) const {
  std::string out;
  append_list(out, "missing", missing);
  append_list(out, "wrong shape", wrong_shape);
  append_list(out, "not floating-point", wrong_dtype);
  append_list(out, "not used by the network", unexpected);
  return out.empty() ? out : source + ": " + out;
}

WeightFit fit(const Graph& graph, const WeightSource& weights) {
  WeightFit result;
  std::set<std::string> wanted;
  for (const Node& node : graph.nodes()) {
    if (node.kind != NodeKind::kParameter) continue;
    wanted.insert(node.name);
    const std::optional<Tensor> found = weights.find(node.name, node.shape);
    if (!found) {
      result.missing.push_back(node.name);
    } else if (found->shape() != node.shape) {
      result.wrong_shape.push_back(node.name + ": has " + found->shape().text() + ", the network needs " +
                                   node.shape.text());
    } else if (!floating(found->dtype())) {
      result.wrong_dtype.push_back(node.name + ": " + std::string(name_of(found->dtype())));
    }
  }
  for (const std::string& name : weights.names())
    if (!wanted.contains(name) && !name.ends_with("num_batches_tracked")) result.unexpected.push_back(name);
  return result;
}

void require_fit(const Graph& graph, const WeightSource& weights) {
  const WeightFit result = fit(graph, weights);
  if (!result.usable())
    throw Error(ErrorKind::kBadWeights, result.message(weights.description()),
                "slide_convert --list FILE shows what a file holds");
}

Tensor parameter(const Node& node, const WeightSource& weights) {
  std::optional<Tensor> found = weights.find(node.name, node.shape);
  if (!found || found->shape() != node.shape)
    throw Error(ErrorKind::kBadWeights,
                weights.description() + ": " + node.name + " changed while it was read");
  weights.check(node.name, *found);
  return std::move(*found);
}

std::map<int, Tensor> bind(const Graph& graph, const WeightSource& weights) {
  require_fit(graph, weights);
  std::map<int, Tensor> tensors;
  for (std::size_t i = 0; i < graph.nodes().size(); ++i)
    if (graph.nodes()[i].kind == NodeKind::kParameter)
      tensors.emplace(static_cast<int>(i), parameter(graph.nodes()[i], weights));
  return tensors;
}

}  // namespace slide
