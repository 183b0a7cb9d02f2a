#pragma once

#include "runtime/graph.h"

namespace slide::ops {

/// Continues a picture by its own mirror image across the outline of what is known.
///
/// Known are the pixels of weight >= 1/2; they keep their values. Another pixel p takes the value at 2·q - p,
/// q the known pixel nearest to p (by squared distance; of equally near ones the first, row by row);
/// positions beyond the border are reflected at the border's pixel centres. The source need not be known
/// itself. Where nothing is known the result is x. Values are copied, never computed.
/// @param x       N×C×H×W
/// @param weight  N×1×H×W
/// Throws Error(kInternal) naming the layer and the shapes that do not fit.
Value mirror_known(Value x, Value weight);

}  // namespace slide::ops
