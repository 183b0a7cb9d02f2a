#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "runtime/weights.h"
#include "weights_tools/weight_reader.h"

namespace slide {

/// How a file's tensors fit one model of the catalogue.
struct ModelFit {
  std::string model;
  WeightFit fit;
  std::size_t matching = 0;        ///< parameters of the model that are there with the right shape
  std::vector<std::string> alike;  ///< other models that closest_model() found to fit equally well
};

/// Throws Error(kUsage) if there is no such model.
[[nodiscard]] ModelFit fit_model(const WeightReader& reader, const std::string& name);

/// The model that fits with the least left over; if none fits, the one with the most parameters matching.
/// Among equals the one that the file's metadata names, else the catalogue's first.
[[nodiscard]] ModelFit closest_model(const WeightReader& reader);

}  // namespace slide
