#include <algorithm>
#include <cmath>
#include <limits>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/pointwise/pointwise_routines.h"
#include "ops/pointwise/unary_op.h"
#include "ops/pointwise/unary_row.h"

namespace slide::ops {
namespace {

/// The attribute rounded to float32, infinite beyond its range.
float rounded(double value) {
  constexpr double kMost = std::numeric_limits<float>::max();
  if (std::fabs(value) > kMost)
    return std::copysign(std::numeric_limits<float>::infinity(), static_cast<float>(value > 0 ? 1 : -1));
  return static_cast<float>(value);
}

/// The largest float32 not above `value`, so that comparing a float32 number with it is comparing it with
/// `value`.
float rounded_down(double value) {
  const float nearest = rounded(value);
  if (static_cast<double>(nearest) <= value) return nearest;
  return std::nextafter(nearest, -std::numeric_limits<float>::infinity());
}

}  // namespace

std::optional<double> activation_slope(const UnaryOp& op) {
  switch (op.kind()) {
    case UnaryKind::kRelu:
    case UnaryKind::kRelu6:
    case UnaryKind::kTanh:
    case UnaryKind::kAbs:
    case UnaryKind::kClip:
      return 1.0;
    case UnaryKind::kSigmoid:
      return 0.25;
    case UnaryKind::kSilu:
      return 1.1;  // 1.0998 at x = 2.4
    case UnaryKind::kGelu:
      return 1.13;  // 1.1290 at x = sqrt(2)
    case UnaryKind::kElu:
    case UnaryKind::kLeakyRelu:
      return std::max(1.0, std::fabs(op.a()));
    default:
      return std::nullopt;
  }
}

UnaryRow unary_row(const UnaryOp& op, const PointwiseRoutines& routines) {
  return {routines.unary[static_cast<std::size_t>(op.kind())],
          op.kind() == UnaryKind::kGreater ? rounded_down(op.a()) : rounded(op.a()), rounded(op.b())};
}

/// The elementary functions' bounds are those of ops/simd/math.h, 1 ULP being at most 2·u relative to the
/// result; each multiplication, addition and rounded attribute is one more u.
double unary_error_factor(const UnaryOp& op) {
  switch (op.kind()) {
    case UnaryKind::kRelu:
    case UnaryKind::kRelu6:
    case UnaryKind::kAbs:
    case UnaryKind::kGreater:
      return 0;
    case UnaryKind::kClip:
    case UnaryKind::kSqrt:
      return 1;
    case UnaryKind::kLeakyRelu:
    case UnaryKind::kExp:
      return rounding_factor(2);
    case UnaryKind::kAffine:
      return rounding_factor(3);
    case UnaryKind::kElu:
    case UnaryKind::kSigmoid:
      return rounding_factor(6);
    case UnaryKind::kTanh:
    case UnaryKind::kSilu:
      return rounding_factor(8);
    case UnaryKind::kGelu:
      return rounding_factor(14);
  }
  return 0;
}

const PointwiseRoutines& pointwise_routines_of(Isa isa) {
  const std::span<const PointwiseRoutines* const> all = pointwise_routines();
  return **std::find_if(all.begin(), all.end(),
                        [&](const PointwiseRoutines* r) { return runs_at(r->isa, isa); });
}

namespace {

class UnaryKernel : public LevelKernel<UnaryOp, PointwiseRoutines> {
 public:
  using LevelKernel::LevelKernel;

 private:
  [[nodiscard]] double factor(const UnaryOp& op, std::span<const Shape> /*inputs*/) const override {
    return unary_error_factor(op);
  }

  void compute(const UnaryOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const UnaryRow f = unary_row(op, routines());
    const float* x = f32(inputs[0]);
    float* y = f32(output);
    for_ranges(output.count(), kElementGrain, [&](std::int64_t begin, std::int64_t end) {
      f(x + begin, y + begin, static_cast<std::size_t>(end - begin));
    });
  }
};

}  // namespace

std::span<const Kernel* const> UnaryOp::kernels() const {
  static const KernelList<UnaryKernel, PointwiseRoutines> list("pointwise.unary", pointwise_routines());
  return list.all();
}

}  // namespace slide::ops
