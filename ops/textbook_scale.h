#pragma once

#include <span>

#include "runtime/op.h"

namespace slide::ops {

/// Adds to an operator's scale (F64, of the output's shape) what rounding errors are proportional to beside
/// it in a program that evaluates the textbook's formula as it stands, and so cancels where the definitions
/// and kernels of this project take care not to:
///     elu         alpha · (exp(x) - 1)                        |alpha| · (exp(x) + 1) for x < 0
///     gelu        x/2 · (1 + erf(x/√2))                       |x|
///     norms       x/σ · weight - mean/σ · weight + bias       2 · |weight| · |mean|/σ
///     resize      weights as polynomials of a coordinate      the largest |x| at most two pixels off the
///     taps
/// Nothing for the other operators.
void add_textbook_scale(const Op& op, std::span<const Tensor> inputs, std::span<double> scale);

}  // namespace slide::ops
