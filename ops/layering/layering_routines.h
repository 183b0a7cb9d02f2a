#pragma once

#include <cstddef>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// The loops of the layering operators, for one instruction-set level.
struct LayeringRoutines {
  Isa isa;

  /// y[j] = taps[0]·centre[0][j] + sum over k = 1..radius of taps[k]·(centre[-k][j] + centre[k][j]), where
  /// centre[-radius..radius] are rows.
  void (*symmetric_sum)(const float* const* centre, const float* taps, std::size_t radius, float* y,
                        std::size_t count);

  /// One row of both Sobel responses divided by 8 from three rows of count + 2 elements.
  void (*sobel_row)(const float* above, const float* middle, const float* below, float* gx, float* gy,
                    std::size_t count);

  bool fused;  ///< whether a·b + c is rounded once
  /// Lines that a cone dilation handles at a time.
  std::size_t cone_lanes;
  /// The dilation along `cone_lanes` interleaved lines of `length` elements, x[i·lanes + lane]:
  ///   y(p) = max over |i - p| <= radius, 0 <= i < length of x(i) - rho·|i - p|.
  /// radius < length. `scratch` holds cone_scratch(radius, lanes) floats.
  void (*cone_lines)(const float* x, std::size_t length, std::size_t radius, float rho, float* y,
                     float* scratch);
};

/// Floats of scratch memory that cone_lines() needs: the suffix maxima of one block.
[[nodiscard]] constexpr std::size_t cone_scratch(std::size_t radius, std::size_t lanes) {
  return 2 * (radius + 1) * lanes;
}

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const LayeringRoutines* const> layering_routines();

}  // namespace slide::ops
