#pragma once

#include <cstddef>
#include <span>

#include "runtime/cpu.h"

namespace slide::ops {

/// Loops over arrays that make one number of many, for one instruction-set level. Sums are in float64, lane
/// by lane in a fixed order. NaN among the elements gives NaN.
struct ReduceRoutines {
  Isa isa;
  double (*sum)(const float* x, std::size_t count);
  /// The sum of (x - mean)².
  double (*squares)(const float* x, std::size_t count, double mean);
  float (*minimum)(const float* x, std::size_t count);  ///< infinity for no elements
  float (*maximum)(const float* x, std::size_t count);  ///< -infinity for no elements
  // Element by element into an array.
  void (*add_to)(double* sum, const float* x, std::size_t count);
  void (*minimum_to)(float* least, const float* x, std::size_t count);
  void (*maximum_to)(float* largest, const float* x, std::size_t count);
};

/// Those of every level of this build, best first.
[[nodiscard]] std::span<const ReduceRoutines* const> reduce_routines();

}  // namespace slide::ops
