// Loops over rows of scores: whole vectors, then a partial one with the same arithmetic.

#include "ops/attention/attention_routines.h"
#include "ops/simd/math.h"
#include "ops/simd/partial.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::Float;
using simd::load_some;
using simd::store_some;
constexpr std::int64_t kWidth = simd::kWidth;

void sum(std::span<const float* const> x, const float* scale, float* y, std::int64_t count) {
  for (std::int64_t j = 0; j < count; j += kWidth) {
    const std::int64_t rest = count - j;
    Float total = load_some(x[0] + j, rest);
    for (std::size_t i = 1; i < x.size(); ++i) total = total + load_some(x[i] + j, rest);
    store_some(y + j, scale != nullptr ? total * load_some(scale + j, rest) : total, rest);
  }
}

void add_scaled(float factor, const float* x, float* y, std::int64_t count) {
  const Float f = simd::broadcast(factor);
  for (std::int64_t j = 0; j < count; j += kWidth)
    store_some(y + j, simd::fma(f, load_some(x + j, count - j), load_some(y + j, count - j)), count - j);
}

void multiply(float factor, const float* x, float* y, std::int64_t count) {
  const Float f = simd::broadcast(factor);
  for (std::int64_t j = 0; j < count; j += kWidth)
    store_some(y + j, load_some(y + j, count - j) * load_some(x + j, count - j) * f, count - j);
}

float largest(const float* x, std::int64_t count) {
  Float top = simd::broadcast(x[0]);
  std::int64_t j = 0;
  for (; j + kWidth <= count; j += kWidth) top = simd::max(simd::load(x + j), top);
  float result = simd::max_of_lanes(top);
  for (; j < count; ++j) result = result < x[j] ? x[j] : result;
  return result;
}

float exponentials(float top, float* x, std::int64_t count) {
  const Float shift = simd::broadcast(top);
  float total = 0;
  for (std::int64_t block = 0; block < count; block += kSumBlock * kWidth) {
    const std::int64_t end = count - block < kSumBlock * kWidth ? count : block + kSumBlock * kWidth;
    Float sum = simd::zero();
    for (std::int64_t j = block; j < end; j += kWidth) {
      store_some(x + j, simd::exp(load_some(x + j, end - j) - shift), end - j);
      sum = sum + load_some(x + j, end - j);  // again, for the zeros beyond the end
    }
    total += simd::sum_of_lanes(sum);
  }
  return total;
}

}  // namespace

extern const AttentionRoutines attention;
const AttentionRoutines attention{Isa::SLIDE_ISA_ENUM, kWidth, sum, add_scaled, multiply, largest,
                                  exponentials};

}  // namespace slide::ops::SLIDE_ISA
