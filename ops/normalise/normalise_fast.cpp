// Statistics are computed in float64 and become a mean, a scale and a shift a channel, in float32; what the
// mean loses by rounding goes into the shift. The elements then take one subtraction, one multiplication and
// one addition. Rounding the difference, the scale, the product and the sum makes four roundings, relative to
// the error scale |scale|·|x - mean| + |bias|. Where float32 does not hold the scale, or a difference could
// overflow, the elements are computed in float64.

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/common/non_temporal.h"
#include "ops/normalise/normalise_ops.h"
#include "ops/normalise/normalise_routines.h"
#include "ops/pointwise/binary_op.h"
#include "ops/pointwise/pointwise_routines.h"
#include "ops/pointwise/unary_op.h"
#include "ops/pointwise/unary_row.h"
#include "ops/reduce/reduce_routines.h"
#include "ops/simd/dispatch.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)      \
  namespace level {                           \
  extern const NormaliseRoutines normalising; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const NormaliseRoutines* const> normalise_routines() {
#define SLIDE_LIST(level, enumerator) &level::normalising,
  static constexpr const NormaliseRoutines* kAll[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return kAll;
}

namespace {

/// What is done to a run of elements, in float64.
struct Standardised {
  double mean, scale, shift;
  float least = -std::numeric_limits<float>::infinity();

  /// Whether float32 holds the scale with all its bits and x - mean for any x: a mean below 2^-102 could make
  /// a difference denormal, which counts as zero. Not so for NaN.
  [[nodiscard]] bool fits_float() const {
    const double size = std::fabs(scale);
    const double far = std::fabs(mean);
    return far < 0x1p102 && (far >= 0x1p-102 || far == 0 || size <= 1) &&
           (size == 0 || (size >= 0x1p-126 && size < 0x1p127)) && std::fabs(shift) < 0x1p127;
  }
  void finish_wide(const float* x, const float* residual, float* y, std::int64_t count) const {
    for (std::int64_t i = 0; i < count; ++i) {
      double value = (static_cast<double>(x[i]) - mean) * scale + shift;
      if (residual != nullptr) value += static_cast<double>(residual[i]);
      y[i] = static_cast<float>(value < static_cast<double>(least) ? static_cast<double>(least) : value);
    }
  }
};

/// Beside its own routines those that normalisation borrows from other families.
struct JoinedRoutines {
  Isa isa;
  const NormaliseRoutines* own;
  const PointwiseRoutines* pointwise;
  const ReduceRoutines* reduce;

  /// y = max(least, scale·(x - mean) + shift + residual); `residual` may be null.
  void finish(const Standardised& row, const float* x, const float* residual, float* y, std::int64_t count,
              bool non_temporal) const {
    if (!row.fits_float()) return row.finish_wide(x, residual, y, count);
    const auto mean = static_cast<float>(row.mean);
    const double shift = row.shift - (row.mean - static_cast<double>(mean)) * row.scale;
    own->finish({x, residual, mean, static_cast<float>(row.scale), static_cast<float>(shift), row.least}, y,
                count, non_temporal);
  }
};

std::span<const JoinedRoutines* const> joined_routines() {
  static const std::vector<JoinedRoutines> levels = [] {
    std::vector<JoinedRoutines> all;
    for (std::size_t i = 0; i < normalise_routines().size(); ++i)
      all.push_back({normalise_routines()[i]->isa, normalise_routines()[i], pointwise_routines()[i],
                     reduce_routines()[i]});
    return all;
  }();
  static const std::vector<const JoinedRoutines*> pointers = [] {
    std::vector<const JoinedRoutines*> all;
    all.reserve(levels.size());
    for (const JoinedRoutines& r : levels) all.push_back(&r);
    return all;
  }();
  return pointers;
}

constexpr int kAffineRoundings = 4;

class BatchNormKernel : public LevelKernel<BatchNormOp, JoinedRoutines> {
 public:
  using LevelKernel::LevelKernel;

 private:
  [[nodiscard]] double factor(const BatchNormOp& /*op*/, std::span<const Shape> /*inputs*/) const override {
    return rounding_factor(kAffineRoundings);
  }
  void compute(const BatchNormOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const AxisView view = axis_view(output.shape(), 1);
    const float* x = f32(inputs[0]);
    float* y = f32(output);
    for_ranges(view.outer * view.axis, 1, [&](std::int64_t plane, std::int64_t) {
      const auto c = static_cast<std::size_t>(plane % view.axis);
      const auto value = [&](std::size_t input) {
        return static_cast<double>(inputs[input].data<float>()[c]);
      };
      const double scale = value(1) / std::sqrt(value(4) + op.eps());
      routines().finish({value(3), scale, value(2)}, x + plane * view.inner, nullptr, y + plane * view.inner,
                        view.inner, false);
    });
  }
};

/// Mean and 1 / sqrt(variance + eps) of an array.
struct Statistics {
  double mean, inverse;
};

/// Memory is read once: a piece's mean and the squares around it are of the first-level cache, and pieces
/// join by the formula of Chan, Golub and LeVeque (1979), which only adds squares.
Statistics statistics(const ReduceRoutines& reduce, const float* x, std::int64_t count, double eps) {
  constexpr std::int64_t kPiece = 4096;
  double mean = 0;
  double squares = 0;
  for (std::int64_t first = 0; first < count; first += kPiece) {
    const std::int64_t piece = std::min(kPiece, count - first);
    const auto n = static_cast<std::size_t>(piece);
    const double piece_mean = reduce.sum(x + first, n) / static_cast<double>(piece);
    const double share = static_cast<double>(piece) / static_cast<double>(first + piece);
    const double apart = piece_mean - mean;
    squares += reduce.squares(x + first, n, piece_mean) + apart * apart * static_cast<double>(first) * share;
    mean += apart * share;
  }
  return {mean, 1 / std::sqrt(squares / static_cast<double>(count) + eps)};
}

class GroupNormKernel : public LevelKernel<GroupNormOp, JoinedRoutines> {
 public:
  using LevelKernel::LevelKernel;

 private:
  /// A residual is one more rounding; the activation's are relative to |y|, which the scale holds beside the
  /// rest.
  [[nodiscard]] double factor(const GroupNormOp& op, std::span<const Shape> /*inputs*/) const override {
    const double sums = rounding_factor(kAffineRoundings + (op.fusion().residual ? 1 : 0));
    return op.fusion().activation ? 1.01 * std::max(sums, unary_error_factor(*op.fusion().activation)) : sums;
  }
  void compute(const GroupNormOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const Nchw in = nchw(output.shape());
    const std::int64_t channels = in.c / op.groups();
    const std::int64_t count = channels * in.plane();
    const float* x = f32(inputs[0]);
    const float* weight = f32(inputs[1]);
    const float* bias = f32(inputs[2]);
    const float* residual = op.fusion().residual ? f32(inputs[3]) : nullptr;
    float* y = f32(output);
    const bool non_temporal = static_cast<std::int64_t>(output.bytes()) >= kNonTemporalBytes;
    for_ranges(in.n * op.groups(), 1, [&](std::int64_t group, std::int64_t) {
      const Statistics s = statistics(*routines().reduce, x + group * count, count, op.eps());
      for (std::int64_t k = 0; k < channels; ++k) {
        const std::int64_t c = group % op.groups() * channels + k;
        const double scale = static_cast<double>(weight[c]) * s.inverse;
        const std::int64_t at = group * count + k * in.plane();
        finish(op.fusion(), x + at, residual != nullptr ? residual + at : nullptr, y + at, in.plane(),
               {s.mean, scale, static_cast<double>(bias[c])}, non_temporal);
      }
      if (non_temporal) non_temporal_fence();
    });
  }

  /// activation(scale·(x - mean) + shift + residual); what no ReLU is in a second pass, a piece at a time, so
  /// that it stays in the first-level cache.
  void finish(const GroupNormFusion& fusion, const float* x, const float* residual, float* y,
              std::int64_t count, Standardised row, bool non_temporal) const {
    constexpr std::int64_t kPiece = 2048;
    const bool relu = fusion.activation && fusion.activation->kind() == UnaryKind::kRelu;
    const bool second_pass = fusion.activation && !relu;
    if (relu) row.least = 0;
    const std::int64_t step = second_pass ? kPiece : count;
    for (std::int64_t first = 0; first < count; first += step) {
      const std::int64_t piece = std::min(step, count - first);
      float* to = y + first;
      routines().finish(row, x + first, residual != nullptr ? residual + first : nullptr, to, piece,
                        non_temporal && !second_pass);
      if (second_pass)
        unary_row(*fusion.activation, *routines().pointwise)(to, to, static_cast<std::size_t>(piece));
    }
  }
};

class WeightStandardiseKernel : public LevelKernel<WeightStandardiseOp, JoinedRoutines> {
 public:
  using LevelKernel::LevelKernel;

 private:
  [[nodiscard]] double factor(const WeightStandardiseOp& /*op*/,
                              std::span<const Shape> /*inputs*/) const override {
    return rounding_factor(kAffineRoundings);
  }
  void compute(const WeightStandardiseOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const std::int64_t filters = output.shape()[0];
    const std::int64_t count = output.count() / filters;
    const float* x = f32(inputs[0]);
    float* y = f32(output);
    for_ranges(filters, 1, [&](std::int64_t filter, std::int64_t) {
      const Statistics s = statistics(*routines().reduce, x + filter * count, count, op.eps());
      routines().finish({s.mean, s.inverse, 0}, x + filter * count, nullptr, y + filter * count, count,
                        false);
    });
  }
};

class MinMaxNormaliseKernel : public LevelKernel<MinMaxNormaliseOp, JoinedRoutines> {
 public:
  using LevelKernel::LevelKernel;

 private:
  /// Numerator, denominator and quotient are rounded.
  [[nodiscard]] double factor(const MinMaxNormaliseOp& /*op*/,
                              std::span<const Shape> /*inputs*/) const override {
    return rounding_factor(3);
  }
  void compute(const MinMaxNormaliseOp& /*op*/, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const float* x = f32(inputs[0]);
    float* y = f32(output);
    const std::int64_t n = output.count();
    std::vector<float> least(static_cast<std::size_t>((n + kElementGrain - 1) / kElementGrain));
    std::vector<float> largest(least.size());
    for_ranges(n, kElementGrain, [&](std::int64_t begin, std::int64_t end) {
      const auto block = static_cast<std::size_t>(begin / kElementGrain);
      least[block] = routines().reduce->minimum(x + begin, static_cast<std::size_t>(end - begin));
      largest[block] = routines().reduce->maximum(x + begin, static_cast<std::size_t>(end - begin));
    });
    const float low = routines().reduce->minimum(least.data(), least.size());
    const float high = routines().reduce->maximum(largest.data(), largest.size());
    const float range = high - low;
    const auto sub = routines().pointwise->binary[static_cast<std::size_t>(BinaryKind::kSub)];
    const auto div = routines().pointwise->binary[static_cast<std::size_t>(BinaryKind::kDiv)];
    for_ranges(n, kElementGrain, [&](std::int64_t begin, std::int64_t end) {
      const auto count = static_cast<std::size_t>(end - begin);
      if (!std::isfinite(low) || !std::isfinite(high)) {
        std::fill(y + begin, y + end, std::numeric_limits<float>::quiet_NaN());
      } else if (without_relief(static_cast<double>(low), static_cast<double>(high))) {
        std::fill(y + begin, y + end, 0.0F);
      } else {
        if (!std::isfinite(range)) return spread(x, y, begin, end, low, high);
        sub(x + begin, 1, &low, 0, y + begin, count);
        div(y + begin, 1, &range, 0, y + begin, count);
      }
    });
  }

  /// The same where float32 does not hold high - low.
  static void spread(const float* x, float* y, std::int64_t begin, std::int64_t end, float low, float high) {
    const double least = static_cast<double>(low);
    const double range = static_cast<double>(high) - least;
    for (std::int64_t i = begin; i < end; ++i)
      y[i] = static_cast<float>((static_cast<double>(x[i]) - least) / range);
  }
};

}  // namespace

std::span<const Kernel* const> BatchNormOp::kernels() const {
  static const KernelList<BatchNormKernel, JoinedRoutines> list("batch_norm.affine", joined_routines());
  return list.all();
}

std::span<const Kernel* const> GroupNormOp::kernels() const {
  static const KernelList<GroupNormKernel, JoinedRoutines> list("group_norm.float64", joined_routines());
  return list.all();
}

std::span<const Kernel* const> WeightStandardiseOp::kernels() const {
  static const KernelList<WeightStandardiseKernel, JoinedRoutines> list("weight_standardise.float64",
                                                                        joined_routines());
  return list.all();
}

std::span<const Kernel* const> MinMaxNormaliseOp::kernels() const {
  static const KernelList<MinMaxNormaliseKernel, JoinedRoutines> list("min_max_normalise.two_pass",
                                                                      joined_routines());
  return list.all();
}

}  // namespace slide::ops
