#pragma once

#include "runtime/graph.h"

namespace slide::graphs {

/// MiDaS v2.1 (isl-org/MiDaS midas/midas_net.py; Ranftl et al., TPAMI 2020): a ResNeXt-101 32×8d encoder and
/// a RefineNet decoder of 256 features.
/// @param x  1×3×H×W, RGB normalised with ImageNet's mean and standard deviation (midas_preprocess()); H and W
///           multiples of 32. Throws Error(kUsage) otherwise.
/// @return 1×1×H×W, inverse depth up to scale and shift, >= 0
Value midas_v21(Value x);

}  // namespace slide::graphs
