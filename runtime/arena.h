#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace slide {

/// A piece of memory that is needed from step `first` to step `last`, both included.
struct ArenaBlock {
  std::size_t bytes;
  int first;
  int last;
};

/// Where each block lies in one common allocation.
struct ArenaLayout {
  std::vector<std::size_t> offsets;  ///< in the order of the blocks, multiples of 64
  std::size_t bytes = 0;             ///< size of the allocation
};

/// Places blocks so that those needed at the same step never overlap: one after the other, each at the lowest
/// offset that is free during its life, largest first ("greedy by size": Pisarchyk and Lee, "Efficient Memory
/// Management for Deep Neural Net Inference", 2020, algorithm 2). Where that leaves gaps, also in the order
/// of size times the life's length or roots of it; the smallest result is taken. Throws Error(kOutOfMemory)
/// if the sum of sizes overflows.
[[nodiscard]] ArenaLayout place(std::span<const ArenaBlock> blocks);

/// The largest sum of sizes needed at any one step: no layout can be smaller.
[[nodiscard]] std::size_t lower_bound(std::span<const ArenaBlock> blocks);

}  // namespace slide
