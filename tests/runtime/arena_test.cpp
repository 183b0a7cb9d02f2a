#include "runtime/arena.h"

#include <doctest/doctest.h>

#include <random>

using namespace slide;

namespace {

bool overlap(std::size_t a, std::size_t a_bytes, std::size_t b, std::size_t b_bytes) {
  return a < b + b_bytes && b < a + a_bytes;
}

}  // namespace

TEST_CASE("blocks that live together never overlap, and no placement is below the lower bound") {
  std::mt19937 random(1);
  for (int round = 0; round < 200; ++round) {
    std::vector<ArenaBlock> blocks(1 + random() % 40);
    for (ArenaBlock& b : blocks) {
      b.first = static_cast<int>(random() % 50);
      b.last = b.first + static_cast<int>(random() % 10);
      b.bytes = random() % 5 == 0 ? 0 : random() % 10000;
    }
    const ArenaLayout layout = place(blocks);
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      REQUIRE(layout.offsets[i] % 64 == 0);
      REQUIRE(layout.offsets[i] + blocks[i].bytes <= layout.bytes);
      for (std::size_t j = 0; j < i; ++j)
        if (blocks[i].first <= blocks[j].last && blocks[j].first <= blocks[i].last)
          REQUIRE(!overlap(layout.offsets[i], blocks[i].bytes, layout.offsets[j], blocks[j].bytes));
    }
    REQUIRE(layout.bytes >= lower_bound(blocks));
  }
}

TEST_CASE("a chain of equal tensors needs two places") {
  std::vector<ArenaBlock> blocks;
  for (int i = 0; i < 20; ++i) blocks.push_back({640, i, i + 1});
  CHECK(place(blocks).bytes == 1280);
  CHECK(lower_bound(blocks) == 1280);
}

TEST_CASE("where the order by size leaves gaps, another order is taken") {
  const std::vector<ArenaBlock> blocks = {{256, 3, 3}, {192, 1, 1}, {256, 2, 3}, {192, 0, 2}};
  CHECK(lower_bound(blocks) == 512);
  CHECK(place(blocks).bytes == 512);  // 704 by size
}
