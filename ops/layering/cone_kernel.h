#pragma once

#ifndef SLIDE_ISA
#error "ops/layering/cone_kernel.h is for sources listed with slide_add_kernels()"
#endif

#include <cstddef>

#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {

/// Two vectors of lines, so that one's latency hides behind the other.
inline constexpr std::size_t kConeLanes = 2 * simd::kWidth;

/// See LayeringRoutines::cone_lines.
void cone_lines(const float* x, std::size_t length, std::size_t radius, float rho, float* y, float* scratch);

}  // namespace slide::ops::SLIDE_ISA
