#include "ops/judge_patterns.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <set>

namespace slide::ops {
namespace {

constexpr double kClose = 1e-3;      // how nearly a pattern of values must hold
constexpr double kNearlyAll = 0.95;  // for how many of the wrong elements

std::int64_t stride_of(const Shape& shape, int axis) {
  std::int64_t stride = 1;
  for (int a = axis + 1; a < shape.rank(); ++a) stride *= shape[a];
  return stride;
}

/// "column 5", in an image's terms where the tensor has four axes.
std::string place(const Shape& shape, int axis) {
  constexpr const char* kNames[] = {"image", "channel", "row", "column"};
  return shape.rank() == 4 ? kNames[axis] : "index of axis " + std::to_string(axis);
}

/// Where the wrong elements lie along one axis; empty if everywhere.
std::string along(const WrongResult& r, int axis) {
  const Shape& shape = r.actual.shape();
  const std::int64_t extent = shape[axis];
  const std::int64_t stride = stride_of(shape, axis);
  if (extent < 2) return "";
  std::set<std::int64_t> seen;
  for (const std::size_t i : r.wrong) seen.insert(static_cast<std::int64_t>(i) / stride % extent);
  if (static_cast<std::int64_t>(seen.size()) == extent) return "";
  const std::int64_t first = *seen.begin();
  if (seen.size() == 1) {
    const bool last = first == extent - 1;
    return "only " + std::string(last ? "the last " : "") + place(shape, axis) + (last ? ", " : " ") +
           std::to_string(first);
  }
  if (*seen.rbegin() == extent - 1 && static_cast<std::int64_t>(seen.size()) == extent - first)
    return "only from " + place(shape, axis) + " " + std::to_string(first) + " on";
  if (static_cast<std::int64_t>(seen.size()) == *seen.rbegin() + 1)
    return "only up to " + place(shape, axis) + " " + std::to_string(*seen.rbegin());
  const std::int64_t period = *std::next(seen.begin()) - first;
  const bool regular =
      period > 1 && std::ranges::all_of(seen, [&](std::int64_t k) { return (k - first) % period == 0; });
  if (regular && static_cast<std::int64_t>(seen.size()) == (extent - 1 - first) / period + 1)
    return "only every " + std::to_string(period) + "th " + place(shape, axis) + ", from " +
           std::to_string(first);
  return "";
}

/// Whether something holds for nearly all wrong elements.
template <typename Holds>
bool nearly_all(const WrongResult& r, Holds holds) {
  const auto count = std::ranges::count_if(r.wrong, holds);
  return static_cast<double>(count) >= kNearlyAll * static_cast<double>(r.wrong.size());
}

bool close(double a, double b, double size) { return std::fabs(a - b) <= kClose * std::fabs(size); }

/// actual = factor · expected, told by the median of the quotients.
std::string factor(const WrongResult& r) {
  const std::span<const double> y = r.actual.data<double>();
  const std::span<const double> e = r.expected.data<double>();
  std::vector<double> quotients;
  for (const std::size_t i : r.wrong)
    if (e[i] != 0 && std::isfinite(y[i] / e[i])) quotients.push_back(y[i] / e[i]);
  if (quotients.size() < 3) return "";
  const auto middle = quotients.begin() + static_cast<std::ptrdiff_t>(quotients.size() / 2);
  std::ranges::nth_element(quotients, middle);
  const double q = *middle;
  if (!nearly_all(
          r, [&](std::size_t i) { return close(y[i], q * e[i], kClose * e[i] + std::fabs(q - 1) * e[i]); }))
    return "";
  if (q == 0) return "0";
  char text[64];
  std::snprintf(text, sizeof text, "%.6g times what they should be", q);
  return text;
}

/// actual[i] = expected[i ± 1 along an axis], beside the border.
std::string shift(const WrongResult& r) {
  const Shape& shape = r.actual.shape();
  const std::span<const double> y = r.actual.data<double>();
  const std::span<const double> e = r.expected.data<double>();
  for (int axis = 0; axis < shape.rank(); ++axis)
    for (const int step : {1, -1}) {
      const std::int64_t stride = stride_of(shape, axis);
      std::size_t compared = 0;
      const bool all = nearly_all(r, [&](std::size_t i) {
        const std::int64_t k = static_cast<std::int64_t>(i) / stride % shape[axis] + step;
        if (k < 0 || k >= shape[axis]) return true;
        ++compared;
        const double other = e[static_cast<std::size_t>(static_cast<std::int64_t>(i) + step * stride)];
        return close(y[i], other, other);
      });
      if (all && compared >= 3 && 2 * compared >= r.wrong.size())
        return std::string("what belongs one ") + place(shape, axis) + (step > 0 ? " further on" : " before");
    }
  return "";
}

/// expected - actual = bias[channel].
std::string bias(const WrongResult& r) {
  const Shape& shape = r.actual.shape();
  for (const auto& [name, tensor] : r.operator_case.inputs) {
    if (name != "bias" || shape.rank() < 2 || tensor.shape().rank() != 1 || tensor.shape()[0] != shape[1])
      continue;
    const Tensor wide = tensor.to(DType::kF64);
    const std::span<const double> b = wide.data<double>();
    const std::span<const double> y = r.actual.data<double>();
    const std::span<const double> e = r.expected.data<double>();
    const std::int64_t stride = stride_of(shape, 1);
    if (nearly_all(r, [&](std::size_t i) {
          const double wanted = b[static_cast<std::size_t>(static_cast<std::int64_t>(i) / stride % shape[1])];
          return wanted != 0 && close(e[i] - y[i], wanted, std::fabs(wanted) + kClose * std::fabs(e[i]));
        }))
      return "without the bias";
  }
  return "";
}

}  // namespace

std::vector<std::string> patterns_of(const WrongResult& r) {
  std::vector<std::string> patterns;
  if (r.wrong.empty()) return patterns;
  std::string where;
  for (int axis = 0; axis < r.actual.shape().rank(); ++axis)
    if (const std::string text = along(r, axis); !text.empty()) where += (where.empty() ? "" : "; ") + text;
  if (!where.empty()) patterns.push_back(where);
  const std::span<const double> y = r.actual.data<double>();
  const auto nans = std::ranges::count_if(r.wrong, [&](std::size_t i) { return std::isnan(y[i]); });
  if (nans > 0) patterns.push_back(std::to_string(nans) + " of the wrong elements are NaN");
  for (const std::string& text : {factor(r), bias(r), shift(r)})
    if (!text.empty()) patterns.push_back("the wrong elements are " + text);
  return patterns;
}

}  // namespace slide::ops
