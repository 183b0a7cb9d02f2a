#include "runtime/storage.h"

#include <algorithm>

#include "runtime/lifetime.h"

namespace slide {
namespace {

std::ptrdiff_t block_bytes(const Shape& shape) {
  return static_cast<std::ptrdiff_t>(
      Tensor::aligned(static_cast<std::size_t>(shape.count()) * sizeof(float)));
}

const SharesStorage* sharing(const Node& node) {
  return node.kind == NodeKind::kOp ? dynamic_cast<const SharesStorage*>(node.op.get()) : nullptr;
}

class Sharing {
 public:
  Sharing(const Graph& graph, std::span<const StoredNode> stored) : graph_(graph) {
    const std::size_t total = graph.nodes().size();
    stored_.assign(total, false);
    state_.inside.assign(total, -1);
    state_.offset.assign(total, 0);
    state_.first.resize(total);
    state_.last.resize(total);
    state_.needed.assign(total + 1, 0);
    for (const StoredNode& s : stored) {
      const auto i = static_cast<std::size_t>(s.node);
      stored_[i] = true;
      state_.first[i] = s.node;
      state_.last[i] = s.last;
      need(block_bytes(graph.node(s.node).shape), s.node, s.last);
      need(static_cast<std::ptrdiff_t>(Tensor::aligned(s.scratch)), s.node, s.node);
    }
    allowed_ = most();
  }

  /// All inputs of node i together, since each alone may keep the result's memory in use without giving its
  /// own back; else as many as fit.
  void share(int i) {
    const Node& node = graph_.node(i);
    const SharesStorage* op = sharing(node);
    if (op == nullptr) return;
    const std::vector<Shape> shapes = input_shapes(graph_, node);
    const State before = state_;
    for (std::size_t k = 0; k < shapes.size(); ++k) put(i, k, op->storage_offset(k, shapes));
    if (most() <= allowed_) return;
    state_ = before;
    for (std::size_t k = 0; k < shapes.size(); ++k) {
      const State without = state_;
      put(i, k, op->storage_offset(k, shapes));
      if (most() > allowed_) state_ = without;
    }
  }

  Storage result() && {
    Storage storage{{}, std::move(state_.first), std::move(state_.last)};
    for (int i = 0; i < static_cast<int>(state_.inside.size()); ++i)
      storage.places.push_back({root(i), static_cast<std::size_t>(offset_in_root(i))});
    return storage;
  }

 private:
  struct State {
    std::vector<int> inside;             // by node: the node in whose memory it lies, -1 for blocks
    std::vector<std::ptrdiff_t> offset;  // in it
    std::vector<int> first, last;        // of blocks
    std::vector<std::ptrdiff_t> needed;  // by node: bytes in use while it is computed
  };

  [[nodiscard]] std::ptrdiff_t most() const { return *std::ranges::max_element(state_.needed); }
  void need(std::ptrdiff_t bytes, int first, int last) {
    for (int t = first; t <= last; ++t) state_.needed[static_cast<std::size_t>(t)] += bytes;
  }
  [[nodiscard]] int inside(int i) const { return state_.inside[static_cast<std::size_t>(i)]; }
  [[nodiscard]] int root(int i) const {
    while (inside(i) >= 0) i = inside(i);
    return i;
  }
  [[nodiscard]] std::ptrdiff_t offset_in_root(int i) const {
    std::ptrdiff_t sum = 0;
    for (; i >= 0; i = inside(i)) sum += state_.offset[static_cast<std::size_t>(i)];
    return sum;
  }

  /// Node i and its input k, which begins at element `start` of it, in one block, if they can be.
  void put(int i, std::size_t k, std::optional<std::int64_t> start) {
    const Node& node = graph_.node(i);
    const int j = node.inputs[k];
    if (!start || !stored_[static_cast<std::size_t>(j)]) return;
    const auto offset = *start * static_cast<std::ptrdiff_t>(sizeof(float));
    if (offset % static_cast<std::ptrdiff_t>(Tensor::kAlignment) != 0) return;
    if (node.inputs.size() == 1)
      put_inside(i, root(j), offset_in_root(j) - offset);
    else if (inside(j) < 0)
      put_inside(j, i, offset);
  }

  /// Block `inner` becomes a part of block `outer`.
  void put_inside(int inner, int outer, std::ptrdiff_t offset) {
    const auto in = static_cast<std::size_t>(inner);
    const auto out = static_cast<std::size_t>(outer);
    const std::ptrdiff_t outer_bytes = block_bytes(graph_.node(outer).shape);
    need(-block_bytes(graph_.node(inner).shape), state_.first[in], state_.last[in]);
    need(-outer_bytes, state_.first[out], state_.last[out]);
    state_.first[out] = std::min(state_.first[out], state_.first[in]);
    state_.last[out] = std::max(state_.last[out], state_.last[in]);
    need(outer_bytes, state_.first[out], state_.last[out]);
    state_.inside[in] = outer;
    state_.offset[in] = offset;
  }

  const Graph& graph_;
  std::vector<bool> stored_;
  State state_;
  std::ptrdiff_t allowed_ = 0;  // bytes in use at the node that needs most without sharing
};

}  // namespace

Storage share_storage(const Graph& graph, std::span<const StoredNode> stored, bool share) {
  Sharing sharing(graph, stored);
  if (share)
    for (const StoredNode& s : stored) sharing.share(s.node);
  return std::move(sharing).result();
}

bool in_place(const Graph& graph, const Storage& storage, int node) {
  const Node& n = graph.node(node);
  const SharesStorage* op = sharing(n);
  if (op == nullptr) return false;
  const std::vector<Shape> shapes = input_shapes(graph, n);
  const Place& result = storage.places[static_cast<std::size_t>(node)];
  for (std::size_t k = 0; k < shapes.size(); ++k) {
    const Place& input = storage.places[static_cast<std::size_t>(n.inputs[k])];
    const std::optional<std::int64_t> start = op->storage_offset(k, shapes);
    if (!start || input.block != result.block ||
        static_cast<std::ptrdiff_t>(input.offset) !=
            static_cast<std::ptrdiff_t>(result.offset) + *start * static_cast<std::ptrdiff_t>(sizeof(float)))
      return false;
  }
  return true;
}

}  // namespace slide
