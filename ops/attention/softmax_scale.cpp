#include "ops/attention/softmax_scale.h"

#include <algorithm>
#include <cmath>

namespace slide::ops {
namespace {

/// For each index the sum of all other numbers, which none of them is taken off from.
std::vector<double> sums_of_others(const std::vector<double>& x) {
  std::vector<double> sums(x.size(), 0);
  double before = 0;
  for (std::size_t j = 0; j < x.size(); before += x[j++]) sums[j] = before;
  double behind = 0;
  for (std::size_t j = x.size(); j-- > 0; behind += x[j]) sums[j] += behind;
  return sums;
}

}  // namespace

std::vector<double> softmax_error_weights(std::span<const double> scores, std::span<const double> a,
                                          double most) {
  const std::size_t n = scores.size();
  const auto top = static_cast<std::size_t>(std::ranges::max_element(scores) - scores.begin());
  std::vector<double> change(n);  // A
  double sum = 0;
  for (std::size_t j = 0; j < n; ++j) {
    change[j] = a[j] + scores[top] - scores[j];
    sum += std::exp(scores[j] - scores[top]);
  }
  const double greatest = *std::ranges::max_element(change);
  std::vector<double> p(n);
  std::vector<double> terms(n);
  for (std::size_t j = 0; j < n; ++j) {
    const double exponent = scores[j] - scores[top] + most * change[j];
    p[j] =
        std::min({1.0, std::exp(exponent + most * greatest) / sum, std::exp(exponent + most * change[top])});
    terms[j] = p[j] > 0 ? p[j] * change[j] : 0;
  }
  const std::vector<double> others = sums_of_others(p);
  const std::vector<double> others_terms = sums_of_others(terms);
  std::vector<double> weights(n);
  for (std::size_t j = 0; j < n; ++j)
    weights[j] = p[j] > 0 ? p[j] * (1 + std::min(1.0, others[j]) * change[j] + others_terms[j]) : 0;
  return weights;
}

}  // namespace slide::ops
