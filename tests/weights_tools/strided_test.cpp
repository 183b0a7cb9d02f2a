#include "weights_tools/strided.h"

#include <doctest/doctest.h>

#include <cstdint>
#include <cstring>
#include <numeric>
#include <span>
#include <vector>

using namespace slide;

namespace {

/// The elements of a view as the blocks give them.
std::vector<std::uint16_t> gathered(std::span<const std::uint16_t> storage, const PickleTensor& view) {
  std::vector<std::uint16_t> out;
  for_each_strided_block(std::as_bytes(storage), 2, view, [&](std::span<const std::byte> block) {
    CHECK(block.size() <= std::size_t{1} << 20);
    CHECK(block.size() % 2 == 0);
    const std::size_t before = out.size();
    out.resize(before + block.size() / 2);
    std::memcpy(out.data() + before, block.data(), block.size());
  });
  return out;
}

}  // namespace

TEST_CASE("a strided view is the elements that its definition names, in row-major order") {
  std::vector<std::uint16_t> storage(2000);
  std::iota(storage.begin(), storage.end(), std::uint16_t{0});
  const std::vector<PickleTensor> views = {
      {0, 7, {}, {}},
      {0, 0, {5}, {1}},
      {0, 3, {5}, {13}},
      {0, 1, {4, 5}, {5, 1}},
      {0, 1, {4, 5}, {1, 4}},
      {0, 1, {4, 5}, {0, 1}},
      {0, 1, {4, 5}, {1, 0}},
      {0, 2, {3, 1, 4}, {4, 999, 1}},
      {0, 0, {2, 3, 4, 5, 6}, {1, 2, 6, 24, 120}},
      {0, 0, {2, 3, 4, 5, 6}, {360, 120, 30, 6, 1}},
      {0, 9, {2, 2, 2, 2, 2}, {800, 11, 400, 3, 100}},
  };
  for (const PickleTensor& view : views) {
    std::vector<std::uint16_t> wanted;
    std::uint64_t count = 1;
    for (const std::uint64_t size : view.sizes) count *= size;
    for (std::uint64_t i = 0; i < count; ++i) {
      std::uint64_t at = view.offset;
      std::uint64_t rest = i;
      for (std::size_t axis = view.sizes.size(); axis-- > 0; rest /= view.sizes[axis])
        at += rest % view.sizes[axis] * view.strides[axis];
      wanted.push_back(storage[at]);
    }
    CHECK(gathered(storage, view) == wanted);
  }
}

TEST_CASE("large views come in several blocks with nothing lost between them") {
  std::vector<std::uint16_t> storage(1'200'000);
  for (std::size_t i = 0; i < storage.size(); ++i) storage[i] = static_cast<std::uint16_t>(i * 40503u >> 4);
  CHECK(gathered(storage, {0, 0, {1'200'000}, {1}}) == storage);
  const std::vector<std::uint16_t> turned = gathered(storage, {0, 0, {1000, 1200}, {1, 1000}});
  REQUIRE(turned.size() == storage.size());
  CHECK(turned[1] == storage[1000]);
  CHECK(turned[1200 * 999 + 1199] == storage[storage.size() - 1]);
  CHECK(turned[1200 * 500 + 600] == storage[600 * 1000 + 500]);
  const std::vector<std::uint16_t> rows = gathered(storage, {0, 100, {3, 300'000}, {400'000, 1}});
  REQUIRE(rows.size() == 900'000);
  CHECK(rows[0] == storage[100]);
  CHECK(rows[600'000] == storage[800'100]);
  CHECK(rows.back() == storage[800'100 + 299'999]);
}
