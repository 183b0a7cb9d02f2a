#include "ops/simd/array_math.h"

#include <string>

#include "ops/simd/dispatch.h"
#include "runtime/error.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator) \
  namespace level {                      \
  extern const ArrayMath array_math;     \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

const ArrayMath& array_math(Isa isa) {
#define SLIDE_RETURN(level, enumerator) \
  if (runs_at(enumerator, isa)) return level::array_math;
  SLIDE_EACH_ISA(SLIDE_RETURN)
#undef SLIDE_RETURN
  throw Error(ErrorKind::kInternal, "this build has no kernels for the level " + std::string(name_of(isa)));
}

}  // namespace slide::ops
