#pragma once

#include "runtime/graph.h"

namespace slide::ops {

// One value in, one value out; any shape. NaN in gives NaN out, except for greater().
Value relu(Value x);                                ///< max(x, 0)
Value relu6(Value x);                               ///< min(max(x, 0), 6)
Value leaky_relu(Value x, double slope);            ///< x, or slope·x where x < 0
Value elu(Value x, double alpha = 1.0);             ///< x, or alpha·(e^x - 1) where x < 0
Value sigmoid(Value x);                             ///< 1 / (1 + e^-x)
Value tanh(Value x);                                ///< hyperbolic tangent
Value exp(Value x);                                 ///< e^x
Value sqrt(Value x);                                ///< square root; NaN below 0
Value abs(Value x);                                 ///< |x|
Value clip(Value x, double low, double high);       ///< min(max(x, low), high)
Value affine(Value x, double scale, double shift);  ///< scale·x + shift
Value greater(Value x, double threshold);           ///< 1 where x > threshold, else 0
Value silu(Value x);                                ///< x / (1 + e^-x); 0 at -infinity
Value gelu(Value x);                                ///< x·(1 + erf(x / sqrt(2))) / 2; 0 at -infinity

// Two values in; shapes broadcast as in NumPy (aligned at the last axis, extents equal or 1).
Value add(Value x, Value other);
Value sub(Value x, Value other);
Value mul(Value x, Value other);
Value div(Value x, Value other);
Value minimum(Value x, Value other);  ///< NaN if either is NaN
Value maximum(Value x, Value other);  ///< NaN if either is NaN

}  // namespace slide::ops
