// The weights of Winograd convolutions, transformed in float64 and packed once; or, for few tiles, packed as
// they are (of bfloat16, rounded) and transformed by each run.

#include <algorithm>
#include <array>
#include <bit>

#include "ops/conv2d/bf16_bits.h"
#include "ops/conv2d/winograd/winograd.h"
#include "ops/conv2d/winograd/winograd_filters.h"
#include "ops/conv2d/winograd/winograd_matrices.h"
#include "ops/simd/dispatch.h"
#include "runtime/threads.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)                \
  namespace level {                                     \
  extern const WinogradFilterRoutines winograd_filters; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

const WinogradFilterRoutines& winograd_filters_at(Isa isa) {
#define SLIDE_FIND(level, enumerator) \
  if (runs_at(enumerator, isa)) return level::winograd_filters;
  SLIDE_EACH_ISA(SLIDE_FIND)
#undef SLIDE_FIND
  return baseline::winograd_filters;
}

WinogradFilterMatrix winograd_filter_matrix(int tile) {
  const WinogradMatrices matrices = winograd_matrices(winograd_pairs(tile));
  WinogradFilterMatrix g{tile / 2, matrices.g[0][0], {}, {}, {}};
  for (int k = 0; k < g.pairs; ++k) {
    const std::vector<double>& row = matrices.g[2 * static_cast<std::size_t>(k) + 1];
    g.one[k] = row[0];
    g.first[k] = row[1];
    g.square[k] = row[2];
  }
  return g;
}

namespace {

constexpr std::int64_t kListedRows = 8;    // read together: filters often lie in the same lines of the cache
constexpr std::int64_t kFetched = 16 * 9;  // numbers ahead: a filter's next words
/// Words of two bfloat16: the first channel's numbers, then the second's.
void join_words(const float* channels, std::int64_t count, float* words) {
  for (std::int64_t i = 0; i < count; ++i)
    words[i] = std::bit_cast<float>(bf16_bits(channels[i]) | bf16_bits(channels[count + i]) << 16U);
}

}  // namespace

std::size_t Conv2dWinogradBase::packed_bytes() const noexcept {
  return static_cast<std::size_t>((late_ ? 9 : frequencies_) * panels_ * words_ * panel_rows_) *
         sizeof(float);
}

/// U as [frequency][part of the words][panel][word][row], zeros below the last filter; or late, see
/// pack_taps().
void Conv2dWinogradBase::pack(const float* weight, std::byte* packed) const {
  const std::int64_t rows = panel_rows_;
  const WinogradFilterMatrix g = winograd_filter_matrix(tile_);
  const WinogradFilters transform = winograd_filters_at(routines_.isa).transform[tile_ / 2 - 1];
  auto* to = static_cast<float*>(static_cast<void*>(packed));
  parallel_for(panels_, [&](std::int64_t panel) {
    if (late_) return pack_taps(weight, panel, to + panel * words_ * 9 * rows);
    std::vector<float> taps(static_cast<std::size_t>(9 * kPackedWords * lanes_ * rows));
    // Frequencies may lie at a distance of powers of two: whole lines, written once, stay out of each other's
    // way.
    std::vector<float> u(static_cast<std::size_t>(frequencies_ * kPackedWords * lanes_ * rows));
    for (std::int64_t k = 0; k < words_;) {
      const std::int64_t part = k / part_depth_ * part_depth_;
      const std::int64_t depth = std::min(part_depth_, words_ - part);
      const std::int64_t words = std::min(kPackedWords, part + depth - k);
      const std::int64_t count = words * lanes_ * rows;
      list_taps(weight, panel * rows, k * lanes_, words * lanes_, taps.data());
      float* first = to + (part * panels_ + panel * depth + k - part) * rows;
      transform(g, taps.data(), count, u.data(), count);
      for (std::int64_t f = 0; f < frequencies_; ++f) {
        const float* from = u.data() + f * count;
        float* line = first + f * words_ * panels_ * rows;
        if (lanes_ == 1)
          std::copy_n(from, count, line);
        else
          for (std::int64_t w = 0; w < words; ++w) join_words(from + 2 * w * rows, rows, line + w * rows);
      }
      k += words;
    }
  });
}

/// A panel's taps as [kPackedWords words][tap][word][row].
void Conv2dWinogradBase::pack_taps(const float* weight, std::int64_t panel, float* packed) const {
  const std::int64_t rows = panel_rows_;
  std::vector<float> taps(static_cast<std::size_t>(9 * kPackedWords * lanes_ * rows));
  for (std::int64_t k = 0; k < words_; k += kPackedWords) {
    const std::int64_t words = std::min(kPackedWords, words_ - k);
    float* to = packed + k * 9 * rows;
    list_taps(weight, panel * rows, k * lanes_, words * lanes_, lanes_ == 1 ? to : taps.data());
    if (lanes_ == 1) continue;
    for (std::int64_t w = 0; w < 9 * words; ++w) join_words(taps.data() + 2 * w * rows, rows, to + w * rows);
  }
}

/// Tap t of channel first_channel + n and row first_row + m is taps[(t·channels + n)·rows + m], zero where
/// there is no such filter or channel.
void Conv2dWinogradBase::list_taps(const float* weight, std::int64_t first_row, std::int64_t first_channel,
                                   std::int64_t channels, float* taps) const {
  const std::int64_t rows = panel_rows_;
  const std::int64_t used = std::clamp<std::int64_t>(g_.ic - first_channel, 0, channels);
  if (used < channels || first_row + rows > g_.oc) std::fill_n(taps, 9 * channels * rows, 0.0F);
  const std::int64_t last_row = std::min(first_row + rows, g_.oc);
  for (std::int64_t begin = first_row; begin < last_row; begin += kListedRows) {
    std::array<const float*, kListedRows> filters{};
    const std::int64_t count = std::min(kListedRows, last_row - begin);
    for (std::int64_t m = 0; m < count; ++m)
      filters[static_cast<std::size_t>(m)] =
          weight + (filter_of_row(g_, gated_, 0, begin + m) * g_.ic + first_channel) * 9;
    for (std::int64_t n = 0; n < used; ++n) {
      for (std::int64_t m = 0; m < count; ++m)
        __builtin_prefetch(filters[static_cast<std::size_t>(m)] + n * 9 + kFetched);
      for (std::int64_t tap = 0; tap < 9; ++tap) {
        float* line = taps + (tap * channels + n) * rows + begin - first_row;
        for (std::int64_t m = 0; m < count; ++m) line[m] = filters[static_cast<std::size_t>(m)][n * 9 + tap];
      }
    }
  }
}

}  // namespace slide::ops
