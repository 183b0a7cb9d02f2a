#pragma once

#include <span>
#include <vector>

namespace slide::ops {

/// What errors of scores do to their softmax p. A score may be off by u·a_j and its exponential, beside that,
/// by u·d_j, d_j being its distance from the largest. By the mean value theorem p_j then changes by u times
///   p_j·((1 - p_j)·A_j + sum over l != j of p_l·A_l),  A = a + d,
/// taken at scores in between, where each p is at most what 256 roundings of float32 may make of it:
/// e^(2^-16·(A_j + max A)) times as much, or e^(2^-16·(A_j + A_top)) times the ratio to the largest one.
/// For each j that, and p_j once more for what is rounded relative to it.
[[nodiscard]] std::vector<double> softmax_error_weights(std::span<const double> scores,
                                                        std::span<const double> a);

}  // namespace slide::ops
