#include "graphs/golden_check.h"

#include <algorithm>
#include <map>

#include "runtime/error.h"

namespace slide::graphs {
namespace {

/// Both executors' tensors of one node.
struct Pair {
  Tensor reference, fast;
};

}  // namespace

bool GoldenCheck::passed() const noexcept {
  return comparison.passed() &&
         std::all_of(tensors.begin(), tensors.end(), [](const GoldenTensorCheck& t) { return t.passed(); });
}

GoldenCheck check_golden(const Golden& golden, const WeightSource& weights, const CompareOptions& options) {
  const std::unique_ptr<Graph> graph = golden.build(weights);
  std::map<int, Pair> wanted;
  for (const auto& output : graph->outputs()) wanted[output.second];
  for (const std::string& tap : golden.taps()) wanted[graph->taps().at(tap)];

  CompareOptions with_visit = options;
  with_visit.visit = [&](int node, const Tensor& reference, const Tensor& fast) {
    if (const auto it = wanted.find(node); it != wanted.end())
      it->second = {reference, fast.empty() ? Tensor() : fast.clone()};
  };
  GoldenCheck check{golden.network(), golden.description(), weights.description(), {}, {}};
  check.comparison = compare(*graph, weights, golden.inputs(*graph), with_visit);

  const auto pair_of = [&](const std::string& name) -> const Pair& {
    const Pair& pair = wanted.at(graph->find(name).value());
    if (pair.reference.empty())
      throw Error(ErrorKind::kBadInput,
                  golden.description() + ": " + name + " is no computed tensor of the network");
    return pair;
  };
  for (const GoldenError& e :
       golden.compare([&](const std::string& name) { return pair_of(name).reference; })) {
    const Pair& pair = pair_of(e.name);
    check.tensors.push_back({e.name, e.output, e.error, e.output ? kGoldenOutput : kGoldenTap,
                             pair.fast.empty() ? TensorError{} : tensor_error(pair.fast, pair.reference)});
  }
  return check;
}

}  // namespace slide::graphs
