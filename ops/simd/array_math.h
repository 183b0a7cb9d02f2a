#pragma once

#include <cstddef>

#include "runtime/cpu.h"

namespace slide::ops {

/// The functions of ops/simd/math.h over arrays: y[i] = f(x[i]) for i < count, y == x allowed. Errors as
/// stated there.
struct ArrayMath {
  using Function = void (*)(const float* x, float* y, std::size_t count);
  Isa isa;
  Function exp;
  Function elu;
  Function sigmoid;
  Function tanh;
  Function silu;
  Function gelu;
};

/// Those compiled for a level. Throws Error(kInternal) if this build has none for it.
[[nodiscard]] const ArrayMath& array_math(Isa isa);

}  // namespace slide::ops
