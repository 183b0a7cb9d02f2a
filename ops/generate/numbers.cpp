#include "ops/generate/numbers.h"

#include <cmath>
#include <limits>

namespace slide::ops {
namespace {

double power(Random& r, double from, double to) { return std::exp2(from + (to - from) * r.real()); }
double sign(Random& r) { return r.chance(0.5) ? -1 : 1; }

/// Whether the sum of an element's indices is odd: neighbours along every axis differ.
bool odd(const Shape& shape, std::int64_t element) {
  std::int64_t sum = 0;
  for (int axis = shape.rank() - 1; axis >= 0; --axis) {
    sum += element % shape[axis];
    element /= shape[axis];
  }
  return sum % 2 != 0;
}

double signal(Trial trial, int reach, bool odd, Random& r) {
  switch (trial) {
    case Trial::kIntegers:
      return static_cast<double>(r.integer(-3, 3));
    case Trial::kConstant:
      return 1.0 / 3;
    case Trial::kLargeMean:
      return 1e4 + r.normal();
    case Trial::kCancelling:
      return (odd ? -1e3 : 1e3) * (1 + 0x1p-12 * r.normal());
    case Trial::kDenormal:
      return sign(r) * power(r, -reach, -120);
    case Trial::kRange:
      return sign(r) * power(r, -reach, reach);
    default:
      return r.normal();
  }
}

double weight(Trial trial, int reach, double terms, Random& r) {
  switch (trial) {
    case Trial::kIntegers:
      return static_cast<double>(r.integer(-1, 1));
    case Trial::kCancelling:
      return (1 + 0x1p-12 * r.normal()) / terms;
    case Trial::kRange:
      return sign(r) * power(r, -reach / 2.0, reach / 2.0);
    default:
      return r.normal() / std::sqrt(terms);
  }
}

double parameter(Trial trial, int reach, Random& r) {
  if (trial == Trial::kIntegers) return static_cast<double>(r.integer(-2, 2));
  if (trial == Trial::kRange) return sign(r) * power(r, -reach / 2.0, reach / 2.0);
  return r.normal();
}

double positive(Trial trial, int reach, Random& r) {
  if (trial == Trial::kIntegers) return static_cast<double>(r.integer(1, 4));
  if (trial == Trial::kRange) return power(r, -reach / 2.0, reach / 2.0);
  return 0.1 + 3 * r.real();
}

double unit(Trial trial, Random& r) {
  const double part = r.real();
  if (trial == Trial::kConstant) return 0.5;
  if (trial == Trial::kIntegers) return part < 0.5 ? 0 : 1;
  return part < 0.3 ? 0 : part < 0.6 ? 1 : r.real();
}

double shade(Trial trial, bool odd, Random& r) {
  switch (trial) {
    case Trial::kIntegers:
      return r.chance(0.5) ? 1 : 0;
    case Trial::kConstant:
      return 1.0 / 3;
    case Trial::kLargeMean:
      return 0.99 + 0.01 * r.real();
    case Trial::kCancelling:
      return odd ? 0x1p-12 * r.real() : 1;
    case Trial::kDenormal:
      return power(r, -126, -100);
    default:
      return r.real();
  }
}

/// The first element, the last and one between become NaN and the infinities; of few elements only some.
void plant(std::span<float> values, Random& r) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  values[static_cast<std::size_t>(r.integer(0, static_cast<std::int64_t>(values.size()) - 1))] = kInfinity;
  if (values.size() < 8) return;
  values.front() = -kInfinity;
  values.back() = std::numeric_limits<float>::quiet_NaN();
}

}  // namespace

Tensor numbers_for(const CallDraftInput& input, Trial trial, int reach, Random& r) {
  Tensor t(DType::kF32, input.shape);
  const double terms = static_cast<double>(input.shape.count()) /
                       static_cast<double>(input.shape.rank() > 0 ? input.shape[0] : 1);
  const std::span<float> values = t.mutable_data<float>();
  for (std::size_t i = 0; i < values.size(); ++i) {
    const bool odd_one = odd(input.shape, static_cast<std::int64_t>(i));
    double v = 0;
    switch (input.content) {
      case Content::kSignal:
        v = signal(trial, reach, odd_one, r);
        break;
      case Content::kWeights:
        v = weight(trial, reach, terms, r);
        break;
      case Content::kParameter:
        v = parameter(trial, reach, r);
        break;
      case Content::kPositive:
        v = positive(trial, reach, r);
        break;
      case Content::kUnit:
        v = unit(trial, r);
        break;
      case Content::kPicture:
        v = shade(trial, odd_one, r);
        break;
    }
    values[i] = static_cast<float>(v);
  }
  if (trial == Trial::kSpecials && input.content == Content::kSignal) plant(values, r);
  return t;
}

}  // namespace slide::ops
