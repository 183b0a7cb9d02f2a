#pragma once

#include <string>

#include "graphs/compare.h"
#include "graphs/golden_check.h"

namespace slide::graphs {

/// One line for each node, largest accumulated error first, and a summary. `rows` > 0: that many lines at
/// most, and whatever failed.
[[nodiscard]] std::string table_of(const Comparison& comparison, int rows = 0);
/// A table of outputs and intermediate tensors in the order of the run, then a summary of the nodes with
/// those that come nearest to their bounds.
[[nodiscard]] std::string table_of(const GoldenCheck& check);

/// The same as JSON objects; numbers that are not finite are null. See docs/slide_check.md.
[[nodiscard]] std::string json_of(const std::string& model, const Comparison& comparison);
[[nodiscard]] std::string json_of(const GoldenCheck& check);

}  // namespace slide::graphs
