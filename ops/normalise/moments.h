#pragma once

#include <cstdint>

namespace slide::ops {

struct Moments {
  double about, rest, variance;  ///< about + rest: the mean

  [[nodiscard]] double mean() const { return about + rest; }
  /// x - mean, not the less exact where both are far larger.
  [[nodiscard]] double centred(double x) const { return x - about - rest; }
};

/// Mean and biased variance of `count` numbers that are `step` apart.
[[nodiscard]] Moments moments(const double* x, std::int64_t count, std::int64_t step = 1);

/// The part of an error scale that float64 statistics of n elements are given, as a multiple of u = 2^-24:
/// the kernels' mean is off by (300 + n/2048)·2^-53 of the mean magnitude, summed in pieces of some lanes;
/// mean and deviation by n·2^-53 of the deviation in any order of summation. The first part also holds the
/// second order of a mean rounded to float32. `inverse` is 1 / sqrt(var + eps).
[[nodiscard]] double statistics_scale(const Moments& m, double inverse, std::int64_t n);

}  // namespace slide::ops
