#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "benchmarks/eval/result.h"

namespace slide::eval {

/// A scene's figures as a table on standard output.
void print(const SceneResult& result);

/// The means over the scenes of each kind, a method a line, as tables on standard output.
void print_means(const std::vector<SceneResult>& results);

/// {"scenes": [{"kind", "scene", facts, "methods": {METHOD: {FIGURE: VALUE, "seconds": .}}}, ...],
///  "means": {KIND: {METHOD: {FIGURE: MEAN, "scenes": COUNT}}}}. What is not a number becomes null.
[[nodiscard]] nlohmann::json to_json(const std::vector<SceneResult>& results);

/// The views of a scene as PNG, and cut-outs of the truth and of every method side by side as JPEG.
/// @throws Error(kOutput)
void write_pictures(const std::string& folder, const SceneResult& result);

}  // namespace slide::eval
