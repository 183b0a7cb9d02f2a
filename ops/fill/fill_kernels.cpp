// Operations and their order are the same at every level, so that all give the same numbers. The pull filters
// a block of columns down the rows first; its sums, with zeros beyond the border, are then read two apart.

#include "ops/fill/fill_op.h"
#include "ops/fill/fill_routines.h"
#include "ops/simd/fetch_ahead.h"
#include "ops/simd/lanes.h"
#include "ops/simd/partial.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::broadcast;
using simd::Float;
using simd::kWidth;
using simd::load_some;
using simd::store_some;

constexpr std::int64_t kBlock = 256;  // cells
constexpr std::int64_t kSums = 2 * kBlock + 2;

/// (1 3 3 1)/8 of four neighbours.
SLIDE_INLINE Float pulled(Float a, Float b, Float c, Float d) {
  return broadcast(static_cast<float>(kPull[0])) * (a + d) +
         broadcast(static_cast<float>(kPull[1])) * (b + c);
}

/// Of numbers 2j to 2j + 3 for kWidth cells j.
SLIDE_INLINE Float pulled_pairs(const float* sums) {
  const Float a = simd::load(sums);
  const Float b = simd::load(sums + kWidth);
  const Float c = simd::load(sums + 2);
  const Float d = simd::load(sums + kWidth + 2);
  return pulled(simd::even(a, b), simd::odd(a, b), simd::even(c, d), simd::odd(c, d));
}

SLIDE_INLINE Float blended(Float x, Float weight, Float behind) {
  return weight * x + (broadcast(1.0F) - weight) * behind;
}

/// What lies in columns first <= v < last of a block that starts at column `left`.
SLIDE_INLINE void pull_columns(const PullRows& r, std::int64_t left, std::int64_t first, std::int64_t last,
                               float* sums, float* weights) {
  for (std::int64_t v = first; v < last; v += kWidth) {
    const std::int64_t rest = last - v;
    for (std::size_t u = 2; u < 4; ++u) {  // the rows that are new
      simd::fetch_ahead(r.x[u] + left + v);
      simd::fetch_ahead(r.weight[u] + left + v);
    }
    const auto weight = [&](std::size_t u) {
      return broadcast(r.inside[u]) * load_some(r.weight[u] + left + v, rest);
    };
    const Float w[] = {weight(0), weight(1), weight(2), weight(3)};
    const auto product = [&](std::size_t u) { return w[u] * load_some(r.x[u] + left + v, rest); };
    store_some(weights + v, pulled(w[0], w[1], w[2], w[3]), rest);
    store_some(sums + v, pulled(product(0), product(1), product(2), product(3)), rest);
  }
}

void pull(const PullRows& r, std::int64_t cells, float* x, float* weight) {
  float sums[kSums + 2 * kWidth];
  float weights[kSums + 2 * kWidth];
  for (std::int64_t j0 = 0; j0 < cells; j0 += kBlock) {
    const std::int64_t count = cells - j0 < kBlock ? cells - j0 : kBlock;
    const std::int64_t left = 2 * j0 - 1;
    const std::int64_t first = left < 0 ? 1 : 0;
    const std::int64_t last = r.width - left < 2 * count + 2 ? r.width - left : 2 * count + 2;
    sums[0] = weights[0] = 0;
    pull_columns(r, left, first, last, sums, weights);
    for (std::int64_t v = last; v < 2 * count + 2 + 2 * kWidth; ++v) sums[v] = weights[v] = 0;
    for (std::int64_t j = 0; j < count; j += kWidth) {
      const Float mean = pulled_pairs(weights + 2 * j);
      const Float least = broadcast(static_cast<float>(kLeastWeight));
      store_some(x + j0 + j, pulled_pairs(sums + 2 * j) / simd::max(least, mean), count - j);
      if (weight != nullptr)
        store_some(weight + j0 + j, simd::min(broadcast(1.0F), broadcast(static_cast<float>(kTrust)) * mean),
                   count - j);
    }
  }
}

void blend(const float* x, const float* weight, const float* behind, float* y, std::int64_t width) {
  for (std::int64_t j = 0; j < width; j += kWidth) {
    const std::int64_t rest = width - j;
    simd::fetch_ahead(x + j);
    simd::fetch_ahead(weight + j);
    store_some(y + j,
               blended(load_some(x + j, rest), load_some(weight + j, rest), load_some(behind + j, rest)),
               rest);
  }
}

void relax(const float* x, const float* weight, const std::array<const float*, 3>& rows, float* y,
           std::int64_t width) {
  const float* above = rows[0];
  const float* here = rows[1];
  const float* under = rows[2];
  const auto alone = [&](std::int64_t j, std::int64_t left, std::int64_t right) {
    const float mean = (above[j] + under[j] + here[left] + here[right]) * 0.25F;
    y[j] = weight[j] * x[j] + (1 - weight[j]) * mean;
  };
  const auto some = [&](std::int64_t j, std::int64_t count) {
    const auto at = [&](const float* row) { return load_some(row + j, count); };
    const Float mean = (at(above) + at(under) + at(here - 1) + at(here + 1)) * broadcast(0.25F);
    store_some(y + j, blended(at(x), at(weight), mean), count);
  };
  alone(0, 0, width > 1 ? 1 : 0);
  const std::int64_t inside = width - 2;
  if (inside > 0) some(1, inside < kWidth - 1 ? inside : kWidth - 1);
  for (std::int64_t j = kWidth; j <= inside; j += kWidth) some(j, inside + 1 - j);
  if (width > 1) alone(width - 1, width - 2, width - 1);
}

}  // namespace

extern const FillRoutines filling;
const FillRoutines filling{Isa::SLIDE_ISA_ENUM, pull, blend, relax};

}  // namespace slide::ops::SLIDE_ISA
