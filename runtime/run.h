#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "runtime/tensor.h"

namespace slide {

/// How far a run is.
struct Progress {
  int done;               ///< nodes finished
  int total;              ///< nodes to run
  std::string_view node;  ///< the node that runs next
};

/// Called before each node, on the calling thread; returning false cancels the run with Error(kCancelled).
using ProgressCallback = std::function<bool(const Progress&)>;

/// What one node took.
struct NodeProfile {
  std::string node;
  std::string kernel;  ///< "reference" or the kernel's name with its ISA level
  double seconds;
  double macs;   ///< of the definition, see Op::macs
  double bytes;  ///< read and written at least once: inputs + output
  [[nodiscard]] double gflops() const noexcept { return seconds > 0 ? 2e-9 * macs / seconds : 0; }
  [[nodiscard]] double gigabytes_per_second() const noexcept {
    return seconds > 0 ? 1e-9 * bytes / seconds : 0;
  }
};

using Profile = std::vector<NodeProfile>;

/// What a run may be given beside its inputs.
struct RunOptions {
  ProgressCallback progress;   ///< may be empty
  Profile* profile = nullptr;  ///< filled if not null
};

/// Input tensors by their names in the graph.
using NamedTensors = std::map<std::string, Tensor, std::less<>>;

}  // namespace slide
