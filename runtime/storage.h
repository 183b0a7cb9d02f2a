#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "runtime/graph.h"

namespace slide {

/// What an operator implements beside Op if its result consists of its inputs' elements, unchanged and in
/// order, so that both may have the same memory. Its kernels leave alone an input that is in its place.
class SharesStorage {
 public:
  SharesStorage() = default;
  SharesStorage(const SharesStorage&) = default;
  SharesStorage& operator=(const SharesStorage&) = default;
  virtual ~SharesStorage() = default;
  /// The element of the result that input `index` begins at (a join), or minus the element of the input that
  /// the result begins at (a part, a reshape). Nothing if the elements do not lie one after the other.
  [[nodiscard]] virtual std::optional<std::int64_t> storage_offset(std::size_t index,
                                                                   std::span<const Shape> inputs) const = 0;
};

/// A node whose tensor gets memory when a plan runs, and how long it needs it.
struct StoredNode {
  int node;
  int last;             ///< the last node that reads it
  std::size_t scratch;  ///< bytes that are needed beside it while it is computed
};

/// Where the tensor of a node lies: in the block of node `block`, from byte `offset`.
struct Place {
  int block;
  std::size_t offset = 0;
};

/// A block of memory, in use from node `first` to node `last`, both included.
struct Storage {
  std::vector<Place> places;     ///< by node; of those that were not given, their own
  std::vector<int> first, last;  ///< by node, for those that are blocks
};

/// Joins tensors and their parts, in the order of the graph, wherever more memory than without is needed at
/// no node: what is joined or taken apart is then not copied. Offsets are multiples of Tensor::kAlignment;
/// a tensor can be in place in one join only. With `share` false every tensor is a block of its own.
[[nodiscard]] Storage share_storage(const Graph& graph, std::span<const StoredNode> stored,
                                    bool share = true);

/// Whether all inputs of a node lie where the result has them.
[[nodiscard]] bool in_place(const Graph& graph, const Storage& storage, int node);

}  // namespace slide
