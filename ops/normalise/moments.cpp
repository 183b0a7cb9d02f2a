#include "ops/normalise/moments.h"

#include <cmath>

namespace slide::ops {

// What the sum loses where the mean is far larger than the deviation is found in a second pass (Chan, Golub
// and LeVeque 1983, "corrected two-pass algorithm").
Moments moments(const double* x, std::int64_t count, std::int64_t step) {
  const double n = static_cast<double>(count);
  double sum = 0;
  for (std::int64_t i = 0; i < count; ++i) sum += x[i * step];
  const double about = sum / n;
  double rest = 0;
  for (std::int64_t i = 0; i < count; ++i) rest += x[i * step] - about;
  Moments m{about, rest / n, 0};
  double squares = 0;
  for (std::int64_t i = 0; i < count; ++i) squares += m.centred(x[i * step]) * m.centred(x[i * step]);
  m.variance = squares / n;
  return m;
}

double statistics_scale(const Moments& m, double inverse, std::int64_t n) {
  const auto count = static_cast<double>(n);
  return 0x1p-29 * ((300 + count / 2048) * std::fabs(m.mean()) * inverse + count);
}

}  // namespace slide::ops
