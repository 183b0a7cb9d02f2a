// One pass over memory: each vector is read, finished and stored.

#include "ops/normalise/normalise_routines.h"
#include "ops/simd/fetch_ahead.h"
#include "ops/simd/non_temporal.h"
#include "ops/simd/partial.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::broadcast;
using simd::Float;
using simd::kWidth;

template <bool kResidual, bool kNonTemporal>
void finish_rows(const NormalisedRow& row, float* y, std::int64_t count) {
  const Float mean = broadcast(row.mean);
  const Float scale = broadcast(row.scale);
  const Float shift = broadcast(row.shift);
  const Float least = broadcast(row.least);
  for (std::int64_t j = 0; j < count; j += kWidth) {
    const std::int64_t rest = count - j;
    simd::fetch_ahead(row.x + j);
    Float value = fma(simd::load_some(row.x + j, rest) - mean, scale, shift);
    if (kResidual) {
      simd::fetch_ahead(row.residual + j);
      value = value + simd::load_some(row.residual + j, rest);
    }
    value = simd::max(least, value);
    if (kNonTemporal) {
      simd::store_non_temporal(y + j, value, rest);
    } else {
      simd::own_ahead(y + j);
      simd::store_some(y + j, value, rest);
    }
  }
}

void finish(const NormalisedRow& row, float* y, std::int64_t count, bool non_temporal) {
  const bool added = row.residual != nullptr;
  if (non_temporal)
    added ? finish_rows<true, true>(row, y, count) : finish_rows<false, true>(row, y, count);
  else
    added ? finish_rows<true, false>(row, y, count) : finish_rows<false, false>(row, y, count);
}

}  // namespace

extern const NormaliseRoutines normalising;
const NormaliseRoutines normalising{Isa::SLIDE_ISA_ENUM, finish};

}  // namespace slide::ops::SLIDE_ISA
