#pragma once

#include <cstdlib>
#include <string>

#include "graphs/golden.h"
#include "runtime/error.h"
#include "runtime/weights.h"
#include "tests/quick.h"

namespace slide::graphs {

/// A golden file of tests/data/networks.
inline Golden golden_file(const std::string& network) {
  return Golden::open(std::string(SLIDE_TEST_DATA) + "/networks/" + network + ".safetensors");
}

using test::quick;

/// All weights that a graph asks a source for, in memory, so that several executors share them.
inline WeightMap weights_in_memory(const Graph& graph, const WeightSource& source) {
  WeightMap map(source.description());
  for (const Node& node : graph.nodes()) {
    if (node.kind != NodeKind::kParameter) continue;
    if (auto tensor = source.find(node.name, node.shape)) map.set(node.name, std::move(*tensor));
  }
  return map;
}

/// What the error thrown by a call says; empty if it throws none.
template <typename Call>
std::string message_of(Call&& call) {
  try {
    call();
  } catch (const Error& e) {
    return e.what();
  }
  return "";
}

}  // namespace slide::graphs
