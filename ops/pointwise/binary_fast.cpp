#include <algorithm>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/pointwise/binary_op.h"
#include "ops/pointwise/broadcast.h"
#include "ops/pointwise/pointwise_routines.h"
#include "ops/simd/dispatch.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)    \
  namespace level {                         \
  extern const PointwiseRoutines pointwise; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const PointwiseRoutines* const> pointwise_routines() {
#define SLIDE_LIST(level, enumerator) &level::pointwise,
  static constexpr const PointwiseRoutines* kAll[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return kAll;
}

namespace {

class BinaryKernel : public LevelKernel<BinaryOp, PointwiseRoutines> {
 public:
  using LevelKernel::LevelKernel;

 private:
  /// One rounding; none for the smaller or larger of two.
  [[nodiscard]] double factor(const BinaryOp& op, std::span<const Shape> /*inputs*/) const override {
    return op.kind() == BinaryKind::kMinimum || op.kind() == BinaryKind::kMaximum ? 0 : 1;
  }

  void compute(const BinaryOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const PointwiseRoutines::Binary f = routines().binary[static_cast<std::size_t>(op.kind())];
    const BroadcastRows rows(inputs[0].shape(), inputs[1].shape(), output.shape());
    const std::int64_t length = rows.length();
    const std::int64_t a_step = rows.a_step();
    const std::int64_t b_step = rows.b_step();
    const float* a = f32(inputs[0]);
    const float* b = f32(inputs[1]);
    float* y = f32(output);
    for_ranges(output.count(), kElementGrain, [&](std::int64_t begin, std::int64_t end) {
      for (std::int64_t i = begin; i < end;) {
        const std::int64_t row = i / length;
        const std::int64_t column = i - row * length;
        const std::int64_t count = std::min(end - i, length - column);
        const BroadcastRows::Start start = rows.start(row);
        f(a + start.a + column * a_step, static_cast<std::size_t>(a_step), b + start.b + column * b_step,
          static_cast<std::size_t>(b_step), y + i, static_cast<std::size_t>(count));
        i += count;
      }
    });
  }
};

}  // namespace

std::span<const Kernel* const> BinaryOp::kernels() const {
  static const KernelList<BinaryKernel, PointwiseRoutines> list("pointwise.binary", pointwise_routines());
  return list.all();
}

}  // namespace slide::ops
