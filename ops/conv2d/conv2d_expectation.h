#pragma once

#include <span>
#include <string_view>

#include "runtime/cpu.h"

namespace slide::ops {

/// What to expect of a method of convolution, for plans with an error budget and for the choice between
/// precisions.
struct Conv2dExpectation {
  std::string_view kernel;
  /// Of the sums: in fp32 in units of u·√error_factor(), else the error itself, which hardly depends on the
  /// shape.
  double error;
  /// Multiply-accumulates done in the time of one of the direct float32 method of the same level (of kAmx: of
  /// the best one below), by level in the order of Isa; where Conv2dCosts has nothing else.
  double speed[kIsaLevels];
};

/// The entry of a kernel's name; all of conv2d have one.
[[nodiscard]] const Conv2dExpectation& conv2d_expectation(std::string_view kernel);

struct Conv2dSpeed {
  std::string_view kernel;
  Isa isa;
  double speed;  ///< as in Conv2dExpectation
};

/// How fast the methods are on some processors.
struct Conv2dCosts {
  std::string_view measured;            ///< on which processor, and when: "Intel Xeon with AMX, 2026-11-29"
  std::string_view vendor;              ///< of the processors it is for, as cpu_vendor(); empty: any
  CpuFeatures features;                 ///< that they have
  std::span<const Conv2dSpeed> speeds;  ///< that differ from Conv2dExpectation's
};

/// The first row of the table that is for such a processor.
[[nodiscard]] const Conv2dCosts& conv2d_costs(std::string_view vendor, CpuFeatures features);
/// That for this processor, which plans are made by.
[[nodiscard]] const Conv2dCosts& conv2d_costs();

[[nodiscard]] double conv2d_speed(const Conv2dCosts& costs, std::string_view kernel, Isa isa);

}  // namespace slide::ops
