#include <algorithm>
#include <vector>

#include "ops/attention/attention_bf16.h"
#include "ops/attention/attention_block.h"
#include "ops/attention/attention_op.h"
#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/simd/dispatch.h"
#include "runtime/threads.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)               \
  namespace level {                                    \
  extern const AttentionBlockRoutines attention_block; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const AttentionBlockRoutines* const> attention_block_routines() {
#define SLIDE_LIST(level, enumerator) &level::attention_block,
  static constexpr const AttentionBlockRoutines* kAll[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return kAll;
}

namespace {

class AttentionKernel : public LevelKernel<AttentionOp, AttentionBlockRoutines> {
 public:
  using LevelKernel::LevelKernel;
  [[nodiscard]] std::size_t scratch_bytes(const Op& op, std::span<const Shape> inputs,
                                          const Shape& /*output*/) const override {
    const AttentionExtents e = static_cast<const AttentionOp&>(op).extents(inputs);
    return static_cast<std::size_t>(thread_count() * slot_size(e)) * sizeof(float);
  }
  /// A key's weight may round to zero, which times an infinite value is NaN.
  /// Scores stay within float32, be it with 2^20 channels and a scale of 1.
  [[nodiscard]] Domain domain() const override { return {.largest_input = 0x1p54, .reach = Reach::kImage}; }

 private:
  /// Of the weighted sum, relative to its terms: a block's keys are added in order, then each block costs 4
  /// (the exponential that lowers what is there, 1 ULP; product; sum), 2 the exponential, in the numerator
  /// and in the denominator; then the division. Of a score: depth + 3 with the scale.
  [[nodiscard]] double factor(const AttentionOp& op, std::span<const Shape> inputs) const override {
    constexpr std::int64_t kKeys = AttentionBlockRoutines::kKeys;
    const AttentionExtents e = op.extents(inputs);
    const std::int64_t blocks = (e.keys + kKeys - 1) / kKeys;
    const std::int64_t sums = 2 * (std::min(e.keys, kKeys) + 4 * blocks + 2) + 1;
    return rounding_factor(static_cast<double>(std::max(sums, e.depth + 3)));
  }
  [[nodiscard]] std::int64_t slot_size(const AttentionExtents& e) const {
    return (e.depth + e.value_depth + AttentionBlockRoutines::kKeys) * routines().lanes;
  }
  void compute(const AttentionOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> scratch) const override {
    const AttentionExtents e = op.extents({{inputs[0].shape(), inputs[1].shape(), inputs[2].shape()}});
    const std::int64_t lanes = routines().lanes;
    const std::int64_t blocks = (e.queries + lanes - 1) / lanes;
    const auto slots = static_cast<std::int64_t>(scratch.size() / sizeof(float)) / slot_size(e);
    auto* memory = reinterpret_cast<float*>(scratch.data());
    parallel_for(e.batch * e.heads * blocks, slots, [&](std::int64_t task, std::int64_t slot) {
      const std::int64_t h = task / blocks;
      const std::int64_t first = task % blocks * lanes;
      const AttentionHead head{.query = f32(inputs[0]) + h * e.depth * e.queries + first,
                               .key = f32(inputs[1]) + h * e.depth * e.keys,
                               .value = f32(inputs[2]) + h * e.value_depth * e.keys,
                               .output = f32(output) + h * e.value_depth * e.queries + first,
                               .depth = e.depth,
                               .value_depth = e.value_depth,
                               .queries = e.queries,
                               .keys = e.keys,
                               .scale = static_cast<float>(op.scale())};
      routines().block(head, std::min(lanes, e.queries - first), memory + slot * slot_size(e));
    });
  }
};

}  // namespace

std::span<const Kernel* const> AttentionOp::kernels() const {
  static const KernelList<AttentionKernel, AttentionBlockRoutines> exact("attention.online",
                                                                         attention_block_routines());
  static const KernelList<AttentionBf16Kernel, AttentionWordsRoutines> rounded("attention.online_bf16",
                                                                               attention_words_routines());
  static const std::vector<const Kernel*> all = [] {
    std::vector<const Kernel*> kernels(exact.all().begin(), exact.all().end());
    kernels.insert(kernels.end(), rounded.all().begin(), rounded.all().end());
    return kernels;
  }();
  return all;
}

}  // namespace slide::ops
