#pragma once

#include <span>

#include "ops/conv2d/conv2d_geometry.h"
#include "runtime/tensor.h"

namespace slide::ops {

/// What the errors of a Winograd convolution of tiles of m = `tile` are measured against, for each sum:
///   |Aᵀ| [(|G| |w| |Gᵀ|) ⊙ (|Bᵀ| |x| |B|) summed over the channels] |A| + |b|,
/// and what underflow adds. inputs are F64: x, weight, perhaps bias.
void winograd_error_scale(int tile, const Conv2dGeometry& g, std::span<const Tensor> inputs,
                          std::span<double> scale);

}  // namespace slide::ops
