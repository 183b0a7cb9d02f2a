#pragma once

#include <span>
#include <vector>

namespace slide::ops {

/// `most` where a score goes through at most 256 roundings of float32.
inline constexpr double k256Roundings = 0x1p-16;

/// What errors of scores do to their softmax p. A score may be off by u·a_j and its exponential, beside that,
/// by u·d_j, d_j being its distance from the largest. By the mean value theorem p_j then changes by u times
///   p_j·((1 - p_j)·A_j + sum over l != j of p_l·A_l),  A = a + d,
/// taken at scores in between, where each p is at most what changes of `most`·A may make of it:
/// e^(most·(A_j + max A)) times as much, or e^(most·(A_j + A_top)) times the ratio to the largest one.
/// For each j that, and p_j once more for what is rounded relative to it.
[[nodiscard]] std::vector<double> softmax_error_weights(std::span<const double> scores,
                                                        std::span<const double> a,
                                                        double most = k256Roundings);

}  // namespace slide::ops
