#include "ops/fusion/fusion.h"

#include "ops/fusion/draft.h"
#include "ops/fusion/rewrites.h"

namespace slide::ops {

std::unique_ptr<Graph> fuse(const Graph& graph, const FusionOptions& options) {
  Draft draft(graph, options);
  for (int i = 0; i < draft.size(); ++i) leave_out_copy(draft, i);
  // In the order of the graph, so that each step of batch norm, residual and activation finds the one before
  // it done. Nodes that folding adds are constant and have nothing to fuse.
  const int nodes = draft.size();
  for (int i = 0; i < nodes; ++i) fuse_behind(draft, i);
  for (int i = 0; i < nodes; ++i) convolve_before_resize(draft, i);
  // Against the order: what stands before a convolution shows when all behind it has been taken in.
  for (int i = nodes - 1; i >= 0; --i) fuse_before(draft, i);
  return draft.graph();
}

}  // namespace slide::ops
