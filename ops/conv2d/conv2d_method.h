#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <string>

#include "ops/conv2d/conv2d_geometry.h"
#include "ops/pointwise/unary_op.h"
#include "runtime/op.h"
#include "runtime/precision.h"

namespace slide::ops {

/// How x is enlarged by 2 in both directions.
enum class Upsampling {
  kNone,
  kNearest,
  kBilinear,  ///< half-pixel: weights 1/4 and 3/4, the border replicated
};

/// What a convolution may do beside convolving, in the order of the computation. A planner joins neighbours
/// of a convolution into it (ops/fusion).
struct Conv2dFusion {
  bool relu_input = false;                        ///< x is max(x, 0); not with bilinear upsampling
  Upsampling upsample_input = Upsampling::kNone;  ///< of x, before it is convolved
  /// Channels of the last input, which follow those of x, bilinearly upsampled, and are of the same size.
  std::int64_t joined = 0;
  bool residual = false;       ///< the input behind the bias, of the output's shape, is added to the sums
  bool residual_last = false;  ///< ... is added to the result of the activation instead
  bool gate = false;           ///< the first half of the channels a, the second g: elu(a) · sigmoid(g)
  std::shared_ptr<const UnaryOp> activation = nullptr;  ///< of the result

  [[nodiscard]] bool upsamples() const noexcept { return upsample_input != Upsampling::kNone; }
};

/// "relu before, residual, relu6", with residual_last "relu6, residual"; empty for a plain convolution.
[[nodiscard]] std::string text_of(const Conv2dFusion& fusion);

/// Channels whose numbers share a 32-bit word of the methods that multiply words.
inline std::int64_t lanes_of(Precision precision) noexcept {
  return precision == Precision::kInt8 ? 4 : precision == Precision::kBf16 ? 2 : 1;
}

/// The tensors of one call.
struct Conv2dArrays {
  const float* x;
  const std::byte* packed;  ///< the weight as the method's pack() left it
  const float* bias;        ///< may be null
  const float* residual;    ///< null unless fused
  float* y;
  std::optional<Range> range = std::nullopt;  ///< of x; for int8
  const float* joined = nullptr;              ///< null unless fused
};

// A method of convolution is a class M with
//   static constexpr Precision kPrecision
//   M(const Conv2dRoutines&, const Conv2dGeometry&, const Conv2dFusion&)
//   static bool fits(const Conv2dGeometry&, const Conv2dFusion&)     it can, and is worth it
//   std::size_t packed_bytes() const; void pack(const float* weight, std::byte* packed) const
//   std::size_t scratch_bytes() const
//   double error_factor() const     roundings that a product meets: c of |y - y64| <= c·u·(|w| ∗ |x| + |b|),
//                                   before residual, activation or gate
//   double macs() const             multiply-accumulates really done
//   void run(const Conv2dArrays&, std::span<std::byte> scratch) const
// With Conv2dFusion::upsample_input the geometry's input is the upsampled one, with the joined channels, x
// the one before.

/// Whether an activation only cuts its argument to a range.
[[nodiscard]] bool only_cuts(const UnaryOp& activation) noexcept;

/// The end of a convolution, for rows of finished sums: residual, activation, gate.
class Conv2dEpilogue {
 public:
  /// With `clamps` the method cuts its sums to [low(), high()] itself, which then stands for an activation
  /// that does no more than that and comes right after the sums.
  Conv2dEpilogue(const Conv2dFusion& fusion, Isa isa, bool clamps = false);

  [[nodiscard]] float low() const noexcept { return low_; }
  [[nodiscard]] float high() const noexcept { return high_; }

  /// Whether there is nothing to do.
  [[nodiscard]] bool empty(const float* residual) const noexcept {
    return function_ == nullptr && residual == nullptr;
  }
  /// y[j] = activation(sums[j] + residual[j]) for j < count, or activation(sums[j]) + residual[j]; residual
  /// may be null, y may be sums. sums is overwritten.
  void finish(float* sums, const float* residual, float* y, std::int64_t count) const;

 private:
  using Function = void (*)(const float* x, float* y, std::size_t count, float a, float b);
  using Add = void (*)(const float* a, std::size_t a_step, const float* b, std::size_t b_step, float* y,
                       std::size_t count);
  Function function_ = nullptr;
  Add add_ = nullptr;
  float a_ = 0, b_ = 0;
  bool residual_last_;
  float low_ = -std::numeric_limits<float>::infinity();
  float high_ = std::numeric_limits<float>::infinity();
};

}  // namespace slide::ops
