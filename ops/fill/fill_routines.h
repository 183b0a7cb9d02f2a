#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// The four rows of a level that make one of the next: values, weights, and the factor 0 that a row beyond
/// the border counts by, else 1.
struct PullRows {
  std::array<const float*, 4> x, weight;
  std::array<float, 4> inside;
  std::int64_t width;
};

/// The loops over rows of push_pull_fill() (ops/fill/fill.h), for one instruction-set level.
struct FillRoutines {
  Isa isa;
  /// x' and, unless null, w' of a row of `cells`.
  void (*pull)(const PullRows& rows, std::int64_t cells, float* x, float* weight);
  /// y = w·x + (1 - w)·behind; y may be `behind`.
  void (*blend)(const float* x, const float* weight, const float* behind, float* y, std::int64_t width);
  /// y = w·x + (1 - w)·mean of the neighbours in three rows.
  void (*relax)(const float* x, const float* weight, const std::array<const float*, 3>& rows, float* y,
                std::int64_t width);
};

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const FillRoutines* const> fill_routines();

}  // namespace slide::ops
