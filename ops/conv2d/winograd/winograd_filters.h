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

/// The filter transforms of a level of this build.
struct WinogradFilterRoutines {
  WinogradFilters transform[3];  ///< by pairs - 1, m = 2·pairs
  /// Of words of two bfloat16, two channels' taps and frequencies: in float32, then rounded to nearest. count
  /// is a multiple of the vector width.
  WinogradFilters transform_words[2];
};

[[nodiscard]] WinogradFilterMatrix winograd_filter_matrix(int tile);
[[nodiscard]] const WinogradFilterRoutines& winograd_filters_at(Isa isa);

}  // namespace slide::ops
