#pragma once

#include "runtime/graph.h"

namespace slide::graphs {

/// MiDaS v2.1 small (isl-org/MiDaS midas/midas_net_custom.py with features = 64 and expand = True, as in its
/// hubconf.py): the encoder is tf_efficientnet_lite3 of rwightman/gen-efficientnet-pytorch (TensorFlow's
/// "same" padding, batch norm with eps 1e-3, ReLU6). Input, output and errors as midas_v21().
Value midas_v21_small(Value x);

}  // namespace slide::graphs
