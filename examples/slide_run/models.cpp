#include "examples/slide_run/models.h"

#include "graphs/catalogue.h"
#include "graphs/formula_weights.h"
#include "runtime/error.h"
#include "runtime/safetensors.h"
#include "weights/default_weights.h"

namespace slide::run {
namespace {

/// Weights made up by a formula: what a network then says means nothing, but its speed and memory are real.
constexpr const char* kFormula = "formula";

std::string model_of(const SafetensorsFile& file, const std::string& given, const std::string& role) {
  if (!given.empty()) return given;
  if (const auto it = file.metadata().find("model"); it != file.metadata().end()) return it->second;
  throw Error(ErrorKind::kBadWeights, file.description() + " does not say which network it is for",
              "give --" + role + "-model NAME, or let slide_convert write the file");
}

}  // namespace

graphs::NetworkChoice Models::open(const std::string& file, const std::string& model,
                                   const std::string& default_model, const std::string& role) {
  if (file == kFormula) {
    sources_.push_back(std::make_unique<graphs::FormulaWeights>(graphs::FormulaWeights::made_up()));
    return {model.empty() ? default_model : model, sources_.back().get()};
  }
  if (!file.empty()) {
    auto weights = std::make_unique<SafetensorsWeights>(file);
    const std::string name = model_of(weights->file(), model, role);
    (void)graphs::find_model(name);
    sources_.push_back(std::move(weights));
    return {name, sources_.back().get()};
  }
  const std::span<const std::byte> built_in = default_weights(default_model);
  if (built_in.empty()) return {};
  sources_.push_back(std::make_unique<SafetensorsWeights>(
      SafetensorsFile::from_memory(built_in, default_model + " (built in)")));
  return {default_model, sources_.back().get()};
}

Models::Models(const Options& o) {
  if (o.depth.empty()) choices_.depth = open(o.depth_weights, o.depth_model, "slide_depth", "depth");
  choices_.inpaint = open(o.inpaint_weights, o.inpaint_model, "slide_inpaint", "inpaint");
  if (o.matte == "auto")
    choices_.saliency = open(o.saliency_weights, o.saliency_model, "slide_matte", "saliency");
}

std::string Models::describe(const graphs::NetworkChoice& choice) const {
  if (!choice.chosen()) return "none";
  const std::string source = choice.weights->description();
  return source.ends_with("(built in)") ? source : choice.model + " (" + source + ")";
}

}  // namespace slide::run
