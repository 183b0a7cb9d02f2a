#pragma once

#include <cstddef>
#include <vector>

#include "runtime/cpu.h"
#include "runtime/graph.h"

namespace slide {

/// One computed node of a plan.
struct PlanStep {
  int node;
  const Kernel* kernel;
  std::size_t offset;          ///< of the result in the arena
  std::size_t scratch_offset;  ///< of the kernel's scratch memory in the arena
  std::size_t scratch_bytes;
  std::size_t packed_bytes;  ///< of the kernel's packed inputs, a multiple of 64
  bool packed_once;          ///< they are constant, packed before the first run; else in scratch, at each run
};

/// How a graph will be run: which nodes are constant and folded, which kernel computes each of the others,
/// and where every tensor lies in one arena.
struct Plan {
  std::vector<PlanStep> steps;
  std::vector<bool> constant;   ///< by node: depends on weights and constants only, computed once in float64
  std::vector<bool> needed;     ///< by node: a step reads its tensor when it runs, or it is an output
  std::size_t arena_bytes = 0;  ///< results and scratch memory
  std::size_t arena_lower_bound = 0;  ///< what no placement could undercut
  std::size_t weight_bytes = 0;       ///< weights and folded constants that the steps read, packed or float32
  Isa isa = Isa::kBaseline;

  /// Memory a run needs beside the caller's inputs.
  [[nodiscard]] std::size_t memory_bytes() const noexcept { return arena_bytes + weight_bytes; }
};

/// Plans a graph for an ISA level: for each node the first kernel of the highest level not above `isa` that
/// supports the shapes and computes in `precision`, else in float32. With `keep_all` no tensor's memory is
/// used again, so that every result can be looked at after the run. Reads no weights. Throws Error(kInternal)
/// if an operator has no kernel for a node.
[[nodiscard]] Plan make_plan(const Graph& graph, Isa isa, bool keep_all = false,
                             Precision precision = Precision::kFp32);

/// Whether a kernel compiled for `kernel` may run where `isa` is the level in use.
[[nodiscard]] bool runs_at(Isa kernel, Isa isa) noexcept;

}  // namespace slide
