#include "ops/attention/attention_bf16.h"

#include <algorithm>
#include <vector>

#include "ops/common/elements.h"
#include "ops/simd/dispatch.h"
#include "runtime/threads.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)               \
  namespace level {                                    \
  extern const AttentionWordsRoutines attention_words; \
  }
SLIDE_EACH_BF16_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const AttentionWordsRoutines* const> attention_words_routines() {
#define SLIDE_LIST(level, enumerator) &level::attention_words,
  static const std::vector<const AttentionWordsRoutines*> all{SLIDE_EACH_BF16_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return all;
}

namespace {

using Routines = AttentionWordsRoutines;

std::int64_t divide_up(std::int64_t a, std::int64_t b) { return (a + b - 1) / b; }

/// Words of a head's keys, and of its values.
struct HeadWords {
  std::int64_t keys, values;
};
HeadWords head_words(const AttentionExtents& e) {
  return {Routines::filled(e.keys, Routines::kFilledKeys) * Routines::key_words(e.depth),
          Routines::value_rows(e.value_depth) * Routines::value_words(e.keys)};
}

}  // namespace

std::size_t AttentionBf16Kernel::scratch_bytes(const Op& op, std::span<const Shape> inputs,
                                               const Shape& /*output*/) const {
  const AttentionExtents e = static_cast<const AttentionOp&>(op).extents(inputs);
  const HeadWords words = head_words(e);
  return static_cast<std::size_t>(e.batch * e.heads * (words.keys + words.values) +
                                  thread_count() * Routines::scratch(e.depth, e.value_depth)) *
         sizeof(float);
}

/// In units of 2^-8, of which a rounding in float32 is 2^-16 and what the exponential is off by 2^-10. A
/// score: queries, keys, two roundings for each word and five for the scale, log2 e, its sum and the distance
/// from the largest. A weighted sum, relative to its terms: weights (above and below the fraction line) and
/// values; exponentials, one for each block; roundings of a block's sums, and the division.
double AttentionBf16Kernel::factor(const AttentionOp& op, std::span<const Shape> inputs) const {
  const AttentionExtents e = op.extents(inputs);
  const auto blocks = static_cast<double>(divide_up(e.keys, Routines::kKeys));
  const double score = 2.01 + static_cast<double>(2 * Routines::key_words(e.depth) + 5) * 0x1p-16;
  const double sum = 3.02 + 2 * (1 + blocks) * (0x1p-10 + 0x1p-16) +
                     (static_cast<double>(2 * Routines::kKeys + 1) + 6 * blocks) * 0x1p-16;
  return std::max(score, sum);
}

bool AttentionBf16Kernel::error_scale(const Op& op, std::span<const Tensor> inputs, const Tensor& /*output*/,
                                      Tensor& scale) const {
  const auto& attention = static_cast<const AttentionOp&>(op);
  const std::vector<Shape> shapes{inputs[0].shape(), inputs[1].shape(), inputs[2].shape()};
  attention.error_scale_of(inputs, factor(attention, shapes) * unit_roundoff(), scale);
  return true;
}

bool AttentionBf16Kernel::expectation_holds(const Tensor& own, const Tensor& scale) const {
  constexpr double kProportional = 4;  // of squares
  const auto squares = [](const Tensor& t) {
    double sum = 0;
    for (const double s : t.data<double>()) sum += s * s;
    return sum;
  };
  return squares(own) <= kProportional * squares(scale);
}

/// Measured at 1,370 positions: 0.25 of what attention.online takes with tiles, 0.5 without.
double AttentionBf16Kernel::cost(const Op& op, std::span<const Shape> inputs, const Shape& output) const {
  return (isa() == Isa::kAmx ? 0.25 : 0.5) * macs(op, inputs, output);
}

void AttentionBf16Kernel::compute(const AttentionOp& op, std::span<const Tensor> inputs, Tensor& output,
                                  std::span<std::byte> scratch) const {
  const AttentionExtents e = op.extents({{inputs[0].shape(), inputs[1].shape(), inputs[2].shape()}});
  const HeadWords words = head_words(e);
  const std::int64_t heads = e.batch * e.heads;
  auto* key_words = reinterpret_cast<float*>(scratch.data());
  float* value_words = key_words + heads * words.keys;
  float* slots = value_words + heads * words.values;
  const std::int64_t runs = divide_up(e.keys, Routines::kFilledKeys);
  const std::int64_t rows = Routines::value_rows(e.value_depth);
  parallel_for(heads * (runs + rows), [&](std::int64_t task) {
    const std::int64_t h = task / (runs + rows);
    const std::int64_t part = task % (runs + rows);
    if (part < runs) {
      const std::int64_t first = part * Routines::kFilledKeys;
      routines().pack_keys(f32(inputs[1]) + h * e.depth * e.keys, e.depth, e.keys, first,
                           key_words + h * words.keys + first * Routines::key_words(e.depth));
      return;
    }
    const std::int64_t c = part - runs;
    float* to = value_words + h * words.values + c * Routines::value_words(e.keys);
    if (c < e.value_depth)
      routines().pack_values(f32(inputs[2]) + (h * e.value_depth + c) * e.keys, e.keys, to);
    else
      std::fill_n(to, Routines::value_words(e.keys), 0.0F);
  });
  const std::int64_t slot_size = Routines::scratch(e.depth, e.value_depth);
  const std::int64_t count =
      (static_cast<std::int64_t>(scratch.size() / sizeof(float)) - (slots - key_words)) / slot_size;
  const std::int64_t blocks = divide_up(e.queries, Routines::kQueries);
  parallel_for(heads * blocks, count, [&](std::int64_t task, std::int64_t slot) {
    const std::int64_t h = task / blocks;
    const std::int64_t first = task % blocks * Routines::kQueries;
    const AttentionWords head{.query = f32(inputs[0]) + h * e.depth * e.queries + first,
                              .key_words = key_words + h * words.keys,
                              .value_words = value_words + h * words.values,
                              .output = f32(output) + h * e.value_depth * e.queries + first,
                              .depth = e.depth,
                              .value_depth = e.value_depth,
                              .queries = e.queries,
                              .keys = e.keys,
                              .scale = static_cast<float>(op.scale())};
    routines().block(head, std::min(Routines::kQueries, e.queries - first), slots + slot * slot_size);
  });
}

}  // namespace slide::ops
