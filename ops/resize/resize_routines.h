#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// The loops of resampling, for one instruction-set level. There are 1, 2 or 4 taps; at 1 the weight is 1.
struct ResizeRoutines {
  Isa isa;
  /// y[j] = sum over k of weight[k·count + j] · x[index[k·count + j]]
  void (*along_row)(const float* x, const std::int32_t* index, const float* weight, int taps, float* y,
                    std::size_t count);
  /// y[j] = sum over k of weight[k] · row[k][j], plus residual[j] unless residual is null
  void (*across_rows)(const float* const* rows, const float* weight, int taps, const float* residual,
                      float* y, std::size_t count);
};

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const ResizeRoutines* const> resize_routines();
/// Those of a level of this build.
[[nodiscard]] const ResizeRoutines& resize_routines(Isa isa);

}  // namespace slide::ops
