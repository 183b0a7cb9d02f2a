#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// One row of a level of foreground_colours(), and the rows above and below it (its own at the border).
struct ForegroundRow {
  std::array<const float*, 3> alpha;  ///< above, here, below
  std::int64_t width;
};
/// The same of one channel: I, the colours before, and where the improved ones go.
struct ForegroundChannel {
  const float* image;
  std::array<const float*, 3> front, behind;
  float* improved_front;
  float* improved_behind;
};

/// The loops over rows of foreground_colours() (ops/matting/foreground.h), for one instruction-set level.
struct ForegroundRoutines {
  Isa isa;
  /// One step for a row of all channels.
  void (*improve)(const ForegroundRow& row, const ForegroundChannel* channels, std::int64_t count);
};

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const ForegroundRoutines* const> foreground_routines();

}  // namespace slide::ops
