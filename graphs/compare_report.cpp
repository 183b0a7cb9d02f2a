#include "graphs/compare_report.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "ops/check_report.h"
#include "runtime/text_table.h"

namespace slide::graphs {
namespace {

using Json = nlohmann::ordered_json;
using Nodes = std::vector<const NodeComparison*>;

constexpr int kNearest = 5;

Nodes pointers(const Comparison& comparison) {
  Nodes nodes;
  for (const NodeComparison& n : comparison.nodes) nodes.push_back(&n);
  return nodes;
}

std::string verdict(const NodeComparison& n) {
  return n.local.passed() ? "ok" : "FAILED: " + n.local.verdict();
}

std::string rows_of(const Nodes& nodes) {
  using enum TextTable::Align;
  TextTable table(
      {"node", "kernel", "shape", "max error", "rms error", "local error", "of bound", "rms/predicted", ""},
      {kLeft, kLeft, kLeft, kRight, kRight, kRight, kRight, kRight, kLeft});
  for (const NodeComparison* n : nodes)
    table.row({n->name, n->local.kernel, n->shape.text(), ops::scientific(n->accumulated.max),
               ops::scientific(n->accumulated.rms), ops::scientific(n->local.error_reference),
               ops::fixed(n->local.of_bound), ops::of_predicted(n->local), verdict(*n)});
  return table.text();
}

std::string summary_of(const Comparison& comparison) {
  const auto failed = std::count_if(comparison.nodes.begin(), comparison.nodes.end(),
                                    [](const NodeComparison& n) { return !n.local.passed(); });
  std::string text = std::to_string(comparison.nodes.size()) + " nodes at level " +
                     std::string(name_of(comparison.isa)) + ": ";
  text += failed == 0 ? "every kernel within its bound" : std::to_string(failed) + " kernels FAILED";
  if (comparison.dumped != 0) text += "; " + std::to_string(comparison.dumped) + " operator cases written";
  return text + "\n";
}

/// The outputs of the fused plan; empty if it was not asked for.
std::string fused_of(const Comparison& comparison) {
  if (comparison.fused.empty()) return "";
  using enum TextTable::Align;
  TextTable table({"fused plan vs float64", "max error", "rms error", "predicted rms"},
                  {kLeft, kRight, kRight, kRight});
  for (const OutputComparison& o : comparison.fused)
    table.row({"output " + o.name, ops::scientific(o.error.max), ops::scientific(o.error.rms),
               ops::scientific(o.predicted)});
  return "\n" + table.text();
}

/// The first `rows` and those behind them that failed.
Nodes shortened(const Nodes& nodes, int rows) {
  Nodes result;
  for (const NodeComparison* n : nodes)
    if (rows <= 0 || static_cast<int>(result.size()) < rows || !n->local.passed()) result.push_back(n);
  return result;
}

Json json_of_nodes(const Comparison& comparison) {
  Json nodes = Json::array();
  for (const NodeComparison& n : comparison.nodes) {
    const auto extents = n.shape.extents();
    nodes.push_back({{"node", n.name},
                     {"op", n.type},
                     {"attributes", n.attributes},
                     {"shape", std::vector<std::int64_t>(extents.begin(), extents.end())},
                     {"kernel", n.local.kernel},
                     {"precision", name_of(n.precision)},
                     {"max_error", n.accumulated.max},
                     {"rms_error", n.accumulated.rms},
                     {"local_error", n.local.error_reference},
                     {"of_bound", n.local.of_bound},
                     {"factor", n.local.factor},
                     {"rms", n.local.rms},
                     {"expected_rms", n.local.expected_rms},
                     {"passed", n.local.passed()},
                     {"problem", n.local.verdict()}});
  }
  return nodes;
}

Json json_of_fused(const Comparison& comparison) {
  Json outputs = Json::array();
  for (const OutputComparison& o : comparison.fused)
    outputs.push_back({{"output", o.name},
                       {"max_error", o.error.max},
                       {"rms_error", o.error.rms},
                       {"predicted_rms_error", o.predicted}});
  return outputs;
}

std::string text_of(const Json& json) {
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace

std::string table_of(const Comparison& comparison, int rows) {
  Nodes nodes = pointers(comparison);
  std::stable_sort(nodes.begin(), nodes.end(), [](const NodeComparison* a, const NodeComparison* b) {
    return a->accumulated.max > b->accumulated.max;
  });
  return rows_of(shortened(nodes, rows)) + summary_of(comparison) + fused_of(comparison);
}

std::string table_of(const GoldenCheck& check) {
  using enum TextTable::Align;
  TextTable table({check.network, "float64 vs golden", "allowed", "", "fast vs float64: max", "rms"},
                  {kLeft, kRight, kRight, kLeft, kRight, kRight});
  for (const GoldenTensorCheck& t : check.tensors)
    table.row({(t.output ? "output " : "") + t.name, ops::scientific(t.reference_error),
               ops::scientific(t.tolerance), t.passed() ? "ok" : "FAILED", ops::scientific(t.fast.max),
               ops::scientific(t.fast.rms)});
  Nodes nodes = pointers(check.comparison);
  std::stable_sort(nodes.begin(), nodes.end(), [](const NodeComparison* a, const NodeComparison* b) {
    return a->local.of_bound > b->local.of_bound;
  });
  return table.text() + "\nnearest to their bounds:\n" + rows_of(shortened(nodes, kNearest)) +
         summary_of(check.comparison) + fused_of(check.comparison);
}

std::string json_of(const std::string& model, const Comparison& comparison) {
  return text_of({{"model", model},
                  {"isa", name_of(comparison.isa)},
                  {"passed", comparison.passed()},
                  {"dumped", comparison.dumped},
                  {"nodes", json_of_nodes(comparison)},
                  {"fused", json_of_fused(comparison)}});
}

std::string json_of(const GoldenCheck& check) {
  Json tensors = Json::array();
  for (const GoldenTensorCheck& t : check.tensors)
    tensors.push_back({{"name", t.name},
                       {"output", t.output},
                       {"float64_vs_golden", t.reference_error},
                       {"tolerance", t.tolerance},
                       {"passed", t.passed()},
                       {"fast_max_error", t.fast.max},
                       {"fast_rms_error", t.fast.rms}});
  return text_of({{"model", check.network},
                  {"golden", check.golden},
                  {"weights", check.weights},
                  {"isa", name_of(check.comparison.isa)},
                  {"passed", check.passed()},
                  {"tensors", tensors},
                  {"nodes", json_of_nodes(check.comparison)},
                  {"fused", json_of_fused(check.comparison)}});
}

}  // namespace slide::graphs
