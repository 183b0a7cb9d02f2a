#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "ops/attention/attention_op.h"
#include "ops/attention/attention_words.h"
#include "ops/common/expectation_limit.h"
#include "ops/common/level_kernel.h"

namespace slide::ops {

/// attention() with queries, keys, values and weights rounded to bfloat16; sums are float32.
class AttentionBf16Kernel : public LevelKernel<AttentionOp, AttentionWordsRoutines>, public ExpectationLimit {
 public:
  using LevelKernel::LevelKernel;
  [[nodiscard]] Precision precision() const override { return Precision::kBf16; }
  /// There is none of 8-bit integers.
  [[nodiscard]] bool replaces_lower(const Op& /*op*/, std::span<const Shape> /*inputs*/) const override {
    return true;
  }
  [[nodiscard]] double unit_roundoff() const override { return 0x1p-8; }
  [[nodiscard]] std::size_t scratch_bytes(const Op& op, std::span<const Shape> inputs,
                                          const Shape& output) const override;
  /// A key's weight may round to zero, which times an infinite value is NaN. Queries grow by log2 e before
  /// they are rounded.
  [[nodiscard]] Domain domain() const override { return {.largest_input = 0x1p126, .reach = Reach::kImage}; }
  /// The operator's, at scores that are off by as much as this kernel's may be.
  bool error_scale(const Op& op, std::span<const Tensor> inputs, const Tensor& output,
                   Tensor& scale) const override;
  /// As long as rounded scores change the weights about in proportion to their roundings: scores of hundreds
  /// are off by whole numbers.
  [[nodiscard]] bool expectation_holds(const Tensor& own, const Tensor& scale) const override;
  [[nodiscard]] double cost(const Op& op, std::span<const Shape> inputs, const Shape& output) const override;

 private:
  [[nodiscard]] double factor(const AttentionOp& op, std::span<const Shape> inputs) const override;
  void compute(const AttentionOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> scratch) const override;
};

}  // namespace slide::ops
