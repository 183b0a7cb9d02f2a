#include <algorithm>
#include <memory>
#include <tuple>

#include "graphs/catalogue.h"
#include "runtime/error.h"
#include "runtime/weights.h"
#include "weights_tools/convert.h"
#include "weights_tools/model_fit.h"

namespace slide {
namespace {

/// The names, types and shapes of a file, without its values: enough to see what fits.
class TensorList : public WeightSource {
 public:
  explicit TensorList(const WeightReader& reader) : reader_(reader) {
    for (const TensorInfo& info : reader.tensors()) index_.emplace(info.name, &info);
  }
  [[nodiscard]] std::string description() const override { return reader_.path(); }
  [[nodiscard]] std::optional<Tensor> find(std::string_view name, const Shape& /*wanted*/) const override {
    const auto it = index_.find(name);
    if (it == index_.end()) return std::nullopt;
    return Tensor::view(it->second->dtype, it->second->shape, nullptr);
  }
  [[nodiscard]] std::vector<std::string> names() const override {
    std::vector<std::string> names;
    names.reserve(reader_.tensors().size());
    for (const TensorInfo& info : reader_.tensors()) names.push_back(info.name);
    return names;
  }

 private:
  const WeightReader& reader_;
  std::map<std::string_view, const TensorInfo*> index_;
};

/// A graph of the model in which every parameter occurs; how large its input is does not matter.
std::unique_ptr<Graph> any_graph(const graphs::Model& model, const TensorList& list) {
  constexpr std::int64_t kSide = 256;
  graphs::BuildOptions options;
  options.height = options.width =
      (kSide + model.size.multiple - 1) / model.size.multiple * model.size.multiple;
  options.weights = &list;
  try {
    return graphs::build_model(model.name, options);
  } catch (const Error& e) {
    if (e.kind() != ErrorKind::kBadWeights) throw;
    options.weights = nullptr;  // they fit no variant: compare with the usual one
    return graphs::build_model(model.name, options);
  }
}

}  // namespace

ModelFit fit_model(const WeightReader& reader, const std::string& name) {
  const TensorList list(reader);
  const graphs::Model& model = graphs::find_model(name);
  const std::unique_ptr<Graph> graph = any_graph(model, list);
  ModelFit result{name, fit(*graph, list), 0, {}};
  std::erase_if(result.fit.unexpected, [&](const std::string& tensor) {
    return std::ranges::any_of(model.unread,
                               [&](std::string_view start) { return tensor.starts_with(start); });
  });
  const auto parameters = std::ranges::count(graph->nodes(), NodeKind::kParameter, &Node::kind);
  const WeightFit& f = result.fit;
  result.matching =
      static_cast<std::size_t>(parameters) - f.missing.size() - f.wrong_shape.size() - f.wrong_dtype.size();
  return result;
}

ModelFit closest_model(const WeightReader& reader) {
  const auto said = reader.metadata().find("model");
  const auto rank = [&](const ModelFit& m) {
    const bool named = said != reader.metadata().end() && said->second == m.model;
    return m.fit.usable() ? std::tuple(1, -static_cast<double>(m.fit.unexpected.size()), named)
                          : std::tuple(0, static_cast<double>(m.matching), named);
  };
  std::optional<ModelFit> best;
  for (const graphs::Model& model : graphs::catalogue()) {
    ModelFit candidate = fit_model(reader, std::string(model.name));
    if (!best || rank(candidate) > rank(*best)) {
      best = std::move(candidate);
    } else if (candidate.fit.usable() && rank(candidate) == rank(*best)) {
      best->alike.push_back(candidate.model);
    }
  }
  return std::move(*best);
}

Detection detect_model(const WeightReader& reader) {
  const ModelFit best = closest_model(reader);
  std::string detail = best.fit.message(reader.path());
  if (best.fit.usable()) {
    for (const std::string& other : best.alike)
      detail.append(detail.empty() ? reader.path() + ": " : "; ")
          .append("the tensors fit " + other + " just as well");
    return {best.model, detail};
  }
  if (best.matching == 0) return {"", reader.path() + ": its tensors belong to none of the models"};
  return {"", best.fit.message(reader.path() + " fits no model, " + best.model + " comes closest")};
}

}  // namespace slide
