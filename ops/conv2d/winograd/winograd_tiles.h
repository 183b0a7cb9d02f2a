#pragma once

#include <algorithm>
#include <cstdint>

namespace slide::ops {

/// How many of the numbers 0 .. extent - 1 are, divided by the dilation, multiples of the tile: where tiles
/// start.
inline std::int64_t tile_count(std::int64_t extent, std::int64_t tile, std::int64_t dilation) {
  const std::int64_t group = tile * dilation;
  return extent / group * dilation + std::min(dilation, extent % group);
}

/// The first row or column of tile `index`.
inline std::int64_t tile_start(std::int64_t index, std::int64_t tile, std::int64_t dilation) {
  return index / dilation * tile * dilation + index % dilation;
}

}  // namespace slide::ops
