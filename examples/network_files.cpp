#include "examples/network_files.h"

#include "graphs/catalogue.h"
#include "graphs/formula_weights.h"
#include "runtime/error.h"
#include "runtime/safetensors.h"
#include "weights/default_weights.h"

namespace slide {
namespace {

std::string model_of(const SafetensorsFile& file, const std::string& given, const std::string& role) {
  if (!given.empty()) return given;
  if (const auto it = file.metadata().find("model"); it != file.metadata().end()) return it->second;
  throw Error(ErrorKind::kBadWeights, file.description() + " does not say which network it is for",
              "give --" + role + "-model NAME, or let slide_convert write the file");
}

}  // namespace

graphs::NetworkChoice NetworkFiles::open(const std::string& file, const std::string& model,
                                         const std::string& default_model, const std::string& role) {
  if (file == "formula") {
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
  if (!model.empty() && (model != default_model || built_in.empty()))
    throw Error(ErrorKind::kUsage, "no weights of " + model + " are inside this program",
                "give --" + role + "-weights FILE");
  if (built_in.empty()) return {};
  sources_.push_back(std::make_unique<SafetensorsWeights>(
      SafetensorsFile::from_memory(built_in, default_model + " (built in)")));
  return {default_model, sources_.back().get()};
}

std::string default_refiner(const graphs::NetworkChoice& saliency) {
  return saliency.model == "slide_matte" ? "slide_rim" : "fba";
}

std::string describe(const graphs::NetworkChoice& choice) {
  if (!choice.chosen()) return "none";
  const std::string source = choice.weights->description();
  return source.ends_with("(built in)") ? source : choice.model + " (" + source + ")";
}

}  // namespace slide
