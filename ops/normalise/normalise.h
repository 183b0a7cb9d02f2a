#pragma once

#include "runtime/graph.h"

namespace slide::ops {

/// Batch normalisation with fixed statistics: y = (x - mean) / sqrt(var + eps) · weight + bias, per channel
/// (axis 1). x: N×C×... of rank 2 to 5; the four others: C.
Value batch_norm(Value x, Value weight, Value bias, Value running_mean, Value running_var, double eps);

/// Group normalisation (Wu and He, ECCV 2018): channels in `groups` equal runs, each normalised with the mean
/// and the biased variance over the run and all positions, then scaled and shifted per channel. x: N×C×H×W;
/// weight, bias: C; C must be a multiple of groups.
Value group_norm(Value x, std::int64_t groups, Value weight, Value bias, double eps);

/// Layer normalisation (Ba, Kiros and Hinton 2016) along one axis (negative: from the end): (x - mean) /
/// sqrt(var + eps) · weight + bias, mean and biased variance over the axis alone. weight, bias: its extent.
Value layer_norm(Value x, int axis, Value weight, Value bias, double eps);

/// Weight standardisation (Qiao et al. 2019) as FBA matting applies it (layers_WS.py): for each filter (axis
/// 0), (w - mean) / sqrt(var + eps), var the biased variance (n in the denominator). weight: O×C×KH×KW.
Value weight_standardise(Value weight, double eps);

/// (x - min) / (max - min) over all elements; zeros everywhere if max - min <= 1e-6 · max(1, |max|), a scene
/// without relief (docs/method.md, section 2). NaN everywhere if an element is NaN or infinite, so that it is never
/// normalised away.
Value min_max_normalise(Value x);

}  // namespace slide::ops
