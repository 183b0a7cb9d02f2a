#pragma once

#include <cstdint>

namespace slide::peak {

/// Loops that do nothing but one instruction as fast as an instruction-set level can. Null: the level has no
/// such instruction.
struct Routines {
  /// Multiply-adds of float32: `operations` (a multiply-add is two) for each of n turns.
  void (*fp32)(std::int64_t n);
  double fp32_operations;
  /// Products of bfloat16 pairs added to float32.
  void (*bf16)(std::int64_t n);
  double bf16_operations;
  /// Products of four 8-bit pairs added to int32.
  void (*int8)(std::int64_t n);
  double int8_operations;
  /// Reads n floats, a multiple of 256, and adds them up.
  float (*read)(const float* x, std::int64_t n);
  void (*copy)(const float* x, float* y, std::int64_t n);
};

namespace baseline {
extern const Routines kRoutines;
}
namespace avx2 {
extern const Routines kRoutines;
}
namespace avx512 {
extern const Routines kRoutines;
}
namespace avx512bf16 {
extern const Routines kRoutines;
}
namespace neon {
extern const Routines kRoutines;
}

}  // namespace slide::peak
