#pragma once

#include <memory>
#include <string>

#include "weights_tools/weight_reader.h"

namespace slide {

/// The first components ("net.", "module.model.") that all names have in common and without which the tensors
/// fit `model` of the catalogue (empty: any of its models). Empty if they fit as they are, or not at all.
[[nodiscard]] std::string needless_prefix(const WeightReader& reader, const std::string& model);

/// The same tensors without a prefix that all their names have.
[[nodiscard]] std::unique_ptr<WeightReader> without_prefix(std::unique_ptr<WeightReader> reader,
                                                           const std::string& prefix);

}  // namespace slide
