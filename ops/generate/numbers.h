#pragma once

#include "ops/generate/draft.h"
#include "ops/generate/generate.h"
#include "runtime/tensor.h"

namespace slide::ops {

/// The numbers of one input in a trial, F32. Magnitudes of kRange are within 2^-reach to 2^reach, those of
/// kDenormal below 2^-120, and from 2^-reach on.
[[nodiscard]] Tensor numbers_for(const CallDraftInput& input, Trial trial, int reach, Random& random);

}  // namespace slide::ops
