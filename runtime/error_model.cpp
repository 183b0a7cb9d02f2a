#include "runtime/error_model.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <string>

#include "runtime/error.h"
#include "runtime/lifetime.h"

namespace slide {
namespace {

/// The shares at one output, which has all of its own error.
std::vector<double> shares_at(const Graph& graph, const std::vector<bool>& constant, int output) {
  std::vector<double> shares(graph.nodes().size(), 0);
  shares[static_cast<std::size_t>(output)] = 1;
  for (int i = output; i >= 0; --i) {
    const Node& node = graph.node(i);
    const double share = shares[static_cast<std::size_t>(i)];
    if (share == 0 || node.kind != NodeKind::kOp) continue;
    const std::vector<Shape> inputs = input_shapes(graph, node);
    for (std::size_t k = 0; k < inputs.size(); ++k)
      if (const auto j = static_cast<std::size_t>(node.inputs[k]); !constant[j])
        shares[j] += share * node.op->error_share(k, inputs);
  }
  return shares;
}

/// By node whether a path leads to it from a marked node, not counting itself.
std::vector<bool> behind(const Graph& graph, const std::vector<bool>& marked) {
  std::vector<bool> result(marked.size(), false);
  for (std::size_t i = 0; i < marked.size(); ++i)
    for (const int j : graph.nodes()[i].inputs)
      if (marked[static_cast<std::size_t>(j)] || result[static_cast<std::size_t>(j)]) result[i] = true;
  return result;
}

/// By node whether a way from it to an output meets no marked node, not counting itself.
std::vector<bool> before_output(const Graph& graph, const std::vector<bool>& marked) {
  std::vector<bool> result(marked.size(), false);
  for (const auto& output : graph.outputs()) result[static_cast<std::size_t>(output.second)] = true;
  for (std::size_t i = marked.size(); i-- > 0;)
    for (const int j : graph.nodes()[i].inputs)
      if (result[i] && !marked[i]) result[static_cast<std::size_t>(j)] = true;
  return result;
}

/// A change of one node's choice.
struct Move {
  std::size_t node = 0, choice = 0;
  double worth = -1;  // cost saved for each square added
};

Move best_move(std::span<const std::vector<KernelChoice>> choices, const std::vector<std::size_t>& chosen,
               double left) {
  Move best;
  for (std::size_t n = 0; n < choices.size(); ++n) {
    const KernelChoice& now = choices[n][chosen[n]];
    for (std::size_t c = 0; c < choices[n].size(); ++c) {
      const KernelChoice& other = choices[n][c];
      const double saved = now.cost - other.cost;
      const double added = other.square - now.square;
      if (saved <= 0 || added > left) continue;
      const double worth = added > 0 ? saved / added : std::numeric_limits<double>::infinity();
      if (worth > best.worth) best = {n, c, worth};
    }
  }
  return best;
}

}  // namespace

std::vector<double> error_shares(const Graph& graph, const std::vector<bool>& constant) {
  std::vector<double> largest(graph.nodes().size(), 0);
  for (const auto& output : graph.outputs()) {
    const std::vector<double> shares = shares_at(graph, constant, output.second);
    for (std::size_t i = 0; i < shares.size(); ++i) largest[i] = std::max(largest[i], shares[i]);
  }
  return largest;
}

std::vector<bool> network_ends(const Graph& graph, const std::vector<bool>& low) {
  const std::vector<bool> later = behind(graph, low);
  const std::vector<bool> last = before_output(graph, low);
  std::vector<bool> ends(low.size(), false);
  bool all = true;
  for (std::size_t i = 0; i < low.size(); ++i) {
    if (!low[i]) continue;
    ends[i] = !later[i] || last[i];
    all = all && ends[i];
  }
  if (all) ends.assign(low.size(), false);
  return ends;
}

std::vector<std::size_t> choose_within(std::span<const std::vector<KernelChoice>> choices, double limit) {
  std::vector<std::size_t> chosen;
  double left = limit;
  for (const std::vector<KernelChoice>& of_node : choices) {
    const auto best =
        std::min_element(of_node.begin(), of_node.end(), [](const KernelChoice& a, const KernelChoice& b) {
          return a.square != b.square ? a.square < b.square : a.cost < b.cost;
        });
    chosen.push_back(static_cast<std::size_t>(best - of_node.begin()));
    left -= best->square;
  }
  // Each move lowers the cost, so this ends. A move that does not fit any more may leave room for a smaller
  // one.
  for (Move move = best_move(choices, chosen, left); move.worth >= 0;
       move = best_move(choices, chosen, left)) {
    left -= choices[move.node][move.choice].square - choices[move.node][chosen[move.node]].square;
    chosen[move.node] = move.choice;
  }
  return chosen;
}

PrecisionChoice precision_choice(std::string_view name, std::optional<double> error_budget) {
  if (error_budget && !(*error_budget >= kLeastErrorBudget && *error_budget <= kLargestErrorBudget))
    throw Error(ErrorKind::kUsage, "the error budget is not between 1e-7 and 1",
                "for example 1e-2 for 1 % of the result's size");
  if (name == "auto" || (name.empty() && error_budget))
    return {Precision::kInt8, error_budget.value_or(kDefaultErrorBudget)};
  const std::optional<Precision> precision = precision_from_name(name.empty() ? "fp32" : name);
  if (!precision)
    throw Error(ErrorKind::kUsage, "there is no precision named " + std::string(name),
                "fp32, bf16, int8 or auto");
  return {*precision, error_budget.value_or(0)};
}

}  // namespace slide
