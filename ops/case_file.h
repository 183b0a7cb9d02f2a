#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "runtime/graph.h"

namespace slide::ops {

/// Builds the graph of an operator case: one operator, named as in the table of docs/operators.md, with its
/// attributes as a JSON object. `inputs` holds the case's input tensors' names and the values that stand for
/// them. Throws Error(kBadInput) naming an unknown operator, a missing or wrong attribute, or a missing
/// input.
Value build_case(std::string_view op, const std::string& attributes_json,
                 const std::vector<std::pair<std::string, Value>>& inputs);

/// The operator names build_case() knows.
[[nodiscard]] std::vector<std::string> case_operators();

}  // namespace slide::ops
