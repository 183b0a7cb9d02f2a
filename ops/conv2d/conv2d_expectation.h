#pragma once

#include <string_view>

#include "runtime/cpu.h"

namespace slide::ops {

/// What to expect of a method of convolution, for plans with an error budget.
struct Conv2dExpectation {
  std::string_view kernel;
  /// Of the sums: in fp32 in units of u·√error_factor(), else the error itself, which hardly depends on the
  /// shape.
  double error;
  /// Multiply-accumulates done in the time of one of the direct float32 method of the same level, by level in
  /// the order of Isa.
  double speed[kIsaLevels];
  [[nodiscard]] double speed_at(Isa isa) const noexcept { return speed[static_cast<int>(isa)]; }
};

/// The entry of a kernel's name; all of conv2d have one.
[[nodiscard]] const Conv2dExpectation& conv2d_expectation(std::string_view kernel);

}  // namespace slide::ops
