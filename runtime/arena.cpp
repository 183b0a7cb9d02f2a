#include "runtime/arena.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "runtime/error.h"

namespace slide {
namespace {

constexpr std::size_t kAlignment = 64;

std::size_t aligned(std::size_t bytes) {
  if (bytes > std::numeric_limits<std::size_t>::max() / 4)
    throw Error(ErrorKind::kOutOfMemory, "a block of " + std::to_string(bytes) + " bytes was asked for");
  return (bytes + kAlignment - 1) / kAlignment * kAlignment;
}

bool alive_together(const ArenaBlock& a, const ArenaBlock& b) {
  return a.first <= b.last && b.first <= a.last;
}

/// Blocks in an order, each at the lowest offset that is free during its life.
ArenaLayout place_in_order(std::span<const ArenaBlock> blocks, std::span<const std::size_t> order) {
  ArenaLayout layout;
  layout.offsets.assign(blocks.size(), 0);
  std::vector<std::size_t> placed;  // indices, sorted by offset
  for (const std::size_t i : order) {
    const std::size_t size = aligned(blocks[i].bytes);
    std::size_t offset = 0;
    for (const std::size_t j : placed) {
      if (!alive_together(blocks[i], blocks[j])) continue;
      if (layout.offsets[j] >= offset + size) break;  // the gap before j is large enough
      offset = std::max(offset, layout.offsets[j] + aligned(blocks[j].bytes));
    }
    layout.offsets[i] = offset;
    if (offset > std::numeric_limits<std::size_t>::max() / 4)
      throw Error(ErrorKind::kOutOfMemory, "the plan needs more memory than can be addressed");
    layout.bytes = std::max(layout.bytes, offset + size);
    placed.insert(
        std::upper_bound(placed.begin(), placed.end(), i,
                         [&](std::size_t a, std::size_t b) { return layout.offsets[a] < layout.offsets[b]; }),
        i);
  }
  return layout;
}

}  // namespace

ArenaLayout place(std::span<const ArenaBlock> blocks) {
  const auto life = [&](std::size_t i) { return static_cast<double>(blocks[i].last - blocks[i].first + 1); };
  const auto size = [&](std::size_t i) { return static_cast<double>(blocks[i].bytes); };
  const std::size_t bound = lower_bound(blocks);
  ArenaLayout best;
  for (int attempt = 0; attempt < 4; ++attempt) {
    std::vector<double> rank(blocks.size());
    std::vector<std::size_t> order(blocks.size());
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      double factor = attempt == 0 ? 1 : life(i);
      for (int root = 1; root < attempt; ++root) factor = std::sqrt(factor);
      rank[i] = size(i) * factor;
    }
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) { return rank[a] > rank[b]; });
    ArenaLayout layout = place_in_order(blocks, order);
    if (attempt == 0 || layout.bytes < best.bytes) best = std::move(layout);
    if (best.bytes <= bound) break;
  }
  return best;
}

std::size_t lower_bound(std::span<const ArenaBlock> blocks) {
  std::size_t largest = 0;
  for (const ArenaBlock& at : blocks) {  // the maximum is reached where some block begins
    std::size_t sum = 0;
    for (const ArenaBlock& b : blocks)
      if (b.first <= at.first && at.first <= b.last) sum += aligned(b.bytes);
    largest = std::max(largest, sum);
  }
  return largest;
}

}  // namespace slide
