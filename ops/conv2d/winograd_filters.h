#pragma once

#include <cstdint>

#include "runtime/cpu.h"

namespace slide::ops {

/// The matrix G of winograd_matrices.h without what its rows share: a pair's two rows are
/// (one, ±first, square).
struct WinogradFilterMatrix {
  int pairs;
  double zero;  ///< G[0][0]
  double one[3], first[3], square[3];
};

/// U = G g Gᵀ of `count` filters of 3 by 3 taps, in float64 and rounded once: tap t of filter n is
/// taps[t·count + n], frequency f of it becomes u[f·frequency_stride + n].
using WinogradFilters = void (*)(const WinogradFilterMatrix& g, const float* taps, std::int64_t count,
                                 float* u, std::int64_t frequency_stride);

/// That of a level of this build, for m = 2·pairs of 2, 4 or 6.
[[nodiscard]] WinogradFilterMatrix winograd_filter_matrix(int tile);
[[nodiscard]] WinogradFilters winograd_filters_at(Isa isa, int pairs);

}  // namespace slide::ops
