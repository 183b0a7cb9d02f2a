// A strip, some lines of tiles or a segment of one, is transformed channel by channel; then its tasks, some
// panels of tiles and of weights, multiply all frequencies one after the other into memory of their own, and
// transform the products back. What a thread writes and soon reads again, a task's products and, where there
// are strips enough for every thread to have its own, the transformed input, stays in the second-level cache;
// the weights stream from the third-level cache once for each task_columns_ panels of tiles.

#include "ops/conv2d/conv2d_winograd.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>

#include "ops/common/non_temporal.h"
#include "ops/conv2d/bf16_bits.h"
#include "ops/conv2d/winograd_filters.h"
#include "ops/conv2d/winograd_matrices.h"
#include "ops/conv2d/winograd_tiles.h"
#include "ops/simd/dispatch.h"
#include "runtime/threads.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)               \
  namespace level {                                    \
  extern const WinogradRoutines winograd_routines;     \
  extern const WinogradFilters winograd_filters_of[3]; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

const WinogradRoutines& winograd_routines(Isa isa) {
#define SLIDE_LIST(level, enumerator) &level::winograd_routines,
  static const WinogradRoutines* const all[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  for (const WinogradRoutines* routines : all)
    if (routines->isa == isa) return *routines;
  return *all[std::size(all) - 1];
}

WinogradFilters winograd_filters_at(Isa isa, int pairs) {
  const WinogradFilters* found = nullptr;
#define SLIDE_FIND(level, enumerator) \
  if (isa == (enumerator)) found = level::winograd_filters_of;
  SLIDE_EACH_ISA(SLIDE_FIND)
#undef SLIDE_FIND
  return (found != nullptr ? found : baseline::winograd_filters_of)[pairs - 1];
}

namespace {

constexpr std::int64_t kPackedWords = 16;    // transformed together: their taps in the first-level cache
constexpr std::int64_t kTaskTiles = 64;      // enough products for each weight that streams by
constexpr std::int64_t kTaskRows = 64;       // with kTaskTiles, 36 frequencies take 432 KiB
constexpr std::int64_t kMinTaskRows = 12;    // fewer read the transformed tiles too often
constexpr std::int64_t kFewTasks = 16;       // with fewer in a shared strip, tasks have fewer rows
constexpr std::int64_t kFewStrips = 8;       // with fewer, threads share them
constexpr std::int64_t kOwnBytes = 1 << 19;  // of a thread's own transformed input
constexpr std::int64_t kNearBytes =
    24 << 10;  // of it, multiplied with all rows of a task: in the first-level cache
constexpr std::int64_t kSharedBytes = 8 << 20;
// Where it is worth it, as measured against direct convolution. Large tiles have more weights to read, which
// few tiles do not pay for; tiles that reach over the edge, or over that of a dilation's phase, multiply in
// vain.
constexpr std::int64_t kMinChannels = 16, kMinTiles2 = 16, kMinTiles = 24;
// Of fewer channels the transforms take most of the time, and they are the same in float32.
constexpr std::int64_t kMinChannelsBf16 = 32;
// As measured against integers.
constexpr std::int64_t kMinHarmonicChannels = 32, kMinTilesBf16 = 128;
// Of so many weights (18 MiB for large tiles, 8 for small ones) few tiles spend as long on reading them as on
// their products: small tiles are as fast then and take less memory.
constexpr std::int64_t kManyWeights = 1 << 17, kMinTilesOfMany = 40;
constexpr double kMostProducts2 = 0.6, kMostProducts = 0.4;  // of 9 for an output
// Frequencies are read and written together; at a distance of powers of two they would share a set of the
// cache.
constexpr std::int64_t kSkew = 16;
constexpr std::int64_t kMaxLanes = 2;

std::int64_t divide_up(std::int64_t a, std::int64_t b) { return (a + b - 1) / b; }
std::int64_t round_up(std::int64_t a, std::int64_t b) { return divide_up(a, b) * b; }

WinogradPoints points_of(int tile) {
  WinogradPoints points{};
  const std::vector<double>& pairs = winograd_pairs(tile);
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    points.square[k] = static_cast<float>(pairs[k] * pairs[k]);
    for (int i = 0; i < tile; ++i) points.power[k][i] = static_cast<float>(std::pow(pairs[k], i));
  }
  return points;
}

const WinogradTransforms& transforms_of(int tile, const WinogradRoutines& routines) {
  return tile == 2 ? routines.two : tile == 4 ? routines.four : routines.six;
}

/// Near the square root of the channels, where the roundings within and of blocks are in balance.
std::int64_t block_depth_for(std::int64_t channels) {
  std::int64_t block = 8;
  while (block * block * 2 < channels) block *= 2;
  return std::min(block, channels);
}

WinogradFilterMatrix filter_matrix(int tile) {
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

/// Sizes of what an input transform needs, in floats.
struct InputMemory {
  std::int64_t zeros, row_size, phase_size;
  [[nodiscard]] std::int64_t total(std::int64_t tile, std::int64_t channels) const {
    return zeros + channels * (tile + 2) * (row_size + tile * phase_size);
  }
};

InputMemory input_memory(const Conv2dGeometry& g, std::int64_t tile, std::int64_t line_tiles) {
  const std::int64_t groups = divide_up(line_tiles, g.dilation_x) + 1;
  const std::int64_t read = tile * std::max(groups * g.dilation_x, line_tiles + kRowAlignment);
  return {round_up(g.width, kRowAlignment), round_up(read, kRowAlignment) + 2 * kRowAlignment,
          round_up(groups * g.dilation_x, kRowAlignment) + 2 * kRowAlignment};
}

/// Words of two bfloat16: the first channel's numbers, then the second's.
void join_words(const float* channels, std::int64_t count, float* words) {
  for (std::int64_t i = 0; i < count; ++i)
    words[i] = std::bit_cast<float>(bf16_bits(channels[i]) | bf16_bits(channels[count + i]) << 16U);
}

/// What is left to do with rows of sums if the output transform adds the residual itself.
Conv2dFusion without_residual(Conv2dFusion fusion) {
  fusion.residual = false;
  return fusion;
}

/// Whether rows are whole lines, of a result too large for the second-level cache.
bool fills_lines(const Conv2dGeometry& g) {
  return g.owidth % kCacheLine == 0 &&
         g.batch * g.oc * g.oplane() * static_cast<std::int64_t>(sizeof(float)) >= kNonTemporalBytes;
}

/// Whether the output transform can finish its rows: they are adjacent columns, and a clamp is all that
/// happens to them beside the residual.
bool finishes_rows(const Conv2dGeometry& g, const Conv2dFusion& fusion, Isa isa) {
  return g.dilation_x == 1 && !fusion.gate &&
         Conv2dEpilogue(without_residual(fusion), isa, true).empty(nullptr);
}

}  // namespace

struct Conv2dWinogradBase::Strip {
  std::int64_t image;
  std::int64_t first_line, last_line;
  std::int64_t first_tile;  // in each of them
  std::int64_t line_tiles;
  std::int64_t panels;                          // of tiles
  std::int64_t panel_stride, frequency_stride;  // of V: [frequency][panel][channel][column]

  [[nodiscard]] std::int64_t tiles() const noexcept { return (last_line - first_line) * line_tiles; }
};

Conv2dWinogradBase::Conv2dWinogradBase(int tile, Precision precision, const Conv2dRoutines& routines,
                                       const Conv2dGeometry& geometry, const Conv2dFusion& fusion)
    : routines_(routines),
      winograd_(winograd_routines(routines.isa)),
      multiplier_(winograd_.multipliers[static_cast<int>(precision)]),
      transforms_(transforms_of(tile, winograd_)),
      precision_(precision),
      g_(geometry),
      gated_(fusion.gate),
      relu_input_(fusion.relu_input),
      upsampled_(fusion.upsample_input),
      finishes_rows_(finishes_rows(geometry, fusion, routines.isa)),
      non_temporal_(finishes_rows_ && fills_lines(geometry)),
      residual_last_(fusion.residual_last),
      epilogue_(finishes_rows_ ? without_residual(fusion) : fusion, routines.isa, finishes_rows_),
      tile_(tile),
      frequencies_((tile + 2) * (tile + 2)),
      points_(points_of(tile)),
      lanes_(lanes_of(precision)),
      words_(divide_up(g_.ic, lanes_)),
      block_depth_(block_depth_for(words_)),
      part_depth_(std::max(kNearBytes / (multiplier_.columns * static_cast<std::int64_t>(sizeof(float))) /
                               block_depth_,
                           std::int64_t{1}) *
                  block_depth_),
      lines_(tile_count(g_.oheight, tile, g_.dilation_y)),
      line_tiles_(tile_count(g_.owidth, tile, g_.dilation_x)),
      phase_size_(round_up(multiplier_.columns, kRowAlignment)),
      segments_(1),
      panels_(divide_up(g_.oc, multiplier_.rows)),
      task_columns_(std::max<std::int64_t>(1, kTaskTiles / multiplier_.columns)) {
  const auto tile_bytes = frequencies_ * words_ * static_cast<std::int64_t>(sizeof(float));
  const std::int64_t own = std::max(kOwnBytes / tile_bytes, kTaskTiles);
  shared_ = g_.batch * lines_ * line_tiles_ < kFewStrips * own;
  const std::int64_t most = shared_ ? std::max(kSharedBytes / tile_bytes, 4 * kTaskTiles) : own;
  if (line_tiles_ > most) {
    const std::int64_t line = line_tiles_;
    // Segments of whole vectors: of a vector's tiles beyond the segment, products are computed in vain.
    line_tiles_ = round_up(round_up(divide_up(line, divide_up(line, most)), kRowAlignment), g_.dilation_x);
    segments_ = divide_up(line, line_tiles_);
  }
  strip_lines_ = segments_ > 1 ? 1 : std::clamp<std::int64_t>(most / line_tiles_, 1, lines_);
  strip_lines_ = divide_up(lines_, divide_up(lines_, strip_lines_));
  strip_panels_ = divide_up(strip_lines_ * line_tiles_, multiplier_.columns);
  std::int64_t rows = std::min(g_.oc, kTaskRows);
  if (shared_) {
    const std::int64_t runs = divide_up(kFewTasks, divide_up(strip_panels_, task_columns_));
    rows = std::clamp(divide_up(g_.oc, runs), std::min(rows, kMinTaskRows), rows);
  }
  task_panels_ = divide_up(rows, multiplier_.rows);
}

bool Conv2dWinogradBase::pays(int tile, const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  const bool possible = g.kheight == 3 && g.kwidth == 3 && g.stride_y == 1 && g.stride_x == 1 &&
                        g.groups == 1 && !(fusion.upsample_input && g.dilation_x != 1);
  if (!possible || g.ic < kMinChannels || g.oc < kMinChannels) return false;
  const std::int64_t tiles =
      g.batch * tile_count(g.oheight, tile, g.dilation_y) * tile_count(g.owidth, tile, g.dilation_x);
  const double products = static_cast<double>(tiles * (tile + 2) * (tile + 2));
  const std::int64_t least = tile == 2                    ? kMinTiles2
                             : g.ic * g.oc < kManyWeights ? kMinTiles
                                                          : kMinTilesOfMany;
  return tiles >= least && products <= (tile == 2 ? kMostProducts2 : kMostProducts) *
                                           static_cast<double>(9 * g.batch * g.oplane());
}

template <int Tile>
bool Conv2dWinograd<Tile>::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return pays(Tile, g, fusion);
}
template class Conv2dWinograd<2>;
template class Conv2dWinograd<4>;
template class Conv2dWinograd<6>;

bool Conv2dWinogradBf16::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return pays(4, g, fusion) && std::min(g.ic, g.oc) >= kMinChannelsBf16;
}

bool Conv2dWinogradBf16::replaces_lower(const Conv2dGeometry& g) noexcept {
  const std::int64_t tiles =
      g.batch * tile_count(g.oheight, 4, g.dilation_y) * tile_count(g.owidth, 4, g.dilation_x);
  return g.ic * g.oc >= kMinHarmonicChannels * (g.ic + g.oc) && tiles >= kMinTilesBf16;
}

double Conv2dWinogradBase::error_factor() const noexcept {
  const std::int64_t pairs = tile_ / 2;
  const std::int64_t fused = winograd_.fused ? 1 : 0;
  const std::int64_t input = fused != 0 ? pairs : 2 * pairs;
  const bool rounded = precision_ == Precision::kBf16;
  const std::int64_t product =
      (rounded ? g_.ic : block_depth_ + divide_up(g_.ic, block_depth_)) + (1 - fused);
  const std::int64_t output = pairs + 1 + (1 - fused);
  const auto roundings = static_cast<double>(2 * input + 1 + product + 2 * output + 1);
  return rounded ? 2.01 + 1.01 * roundings * 0x1p-16 : 1.001 * roundings;
}

double Conv2dWinogradBase::macs() const noexcept {
  const std::int64_t tiles = g_.batch * lines_ * tile_count(g_.owidth, tile_, g_.dilation_x);
  return static_cast<double>(tiles * frequencies_) * static_cast<double>(g_.ic * g_.oc);
}

std::size_t Conv2dWinogradBase::packed_bytes() const noexcept {
  return static_cast<std::size_t>(frequencies_ * panels_ * words_ * multiplier_.rows) * sizeof(float);
}

/// U as [frequency][part of the words][panel][word][row], zeros below the last filter.
void Conv2dWinogradBase::pack(const float* weight, std::byte* packed) const {
  const std::int64_t rows = multiplier_.rows;
  const WinogradFilterMatrix g = filter_matrix(tile_);
  const WinogradFilters transform = winograd_filters_at(routines_.isa, tile_ / 2);
  auto* to = static_cast<float*>(static_cast<void*>(packed));
  parallel_for(panels_, [&](std::int64_t panel) {
    std::vector<double> taps(static_cast<std::size_t>(9 * kPackedWords * lanes_ * rows));
    // Frequencies may lie at a distance of powers of two: whole lines, written once, stay out of each other's
    // way.
    std::vector<float> u(static_cast<std::size_t>(frequencies_ * kPackedWords * lanes_ * rows));
    for (std::int64_t k = 0; k < words_;) {
      const std::int64_t part = k / part_depth_ * part_depth_;
      const std::int64_t depth = std::min(part_depth_, words_ - part);
      const std::int64_t words = std::min(kPackedWords, part + depth - k);
      const std::int64_t count = words * lanes_ * rows;
      list_taps(weight, panel * rows, k * lanes_, words * lanes_, taps);
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

/// Tap t of channel first_channel + n and row first_row + m is taps[(t·channels + n)·rows + m], zero where
/// there is no such filter or channel.
void Conv2dWinogradBase::list_taps(const float* weight, std::int64_t first_row, std::int64_t first_channel,
                                   std::int64_t channels, std::vector<double>& taps) const {
  const std::int64_t rows = multiplier_.rows;
  for (std::int64_t m = 0; m < rows; ++m) {
    const bool filter_inside = first_row + m < g_.oc;
    const std::int64_t filter = filter_inside ? filter_of_row(g_, gated_, 0, first_row + m) : 0;
    const float* from = weight + (filter * g_.ic + first_channel) * 9;
    for (std::int64_t n = 0; n < channels; ++n) {
      const bool inside = filter_inside && first_channel + n < g_.ic;
      for (std::int64_t tap = 0; tap < 9; ++tap)
        taps[static_cast<std::size_t>((tap * channels + n) * rows + m)] =
            inside ? static_cast<double>(from[n * 9 + tap]) : 0.0;
    }
  }
}

std::int64_t Conv2dWinogradBase::strips() const noexcept {
  return g_.batch * divide_up(lines_, strip_lines_) * segments_;
}

Conv2dWinogradBase::Strip Conv2dWinogradBase::strip(std::int64_t index) const noexcept {
  Strip s{};
  s.first_tile = index % segments_ * line_tiles_;
  index /= segments_;
  s.line_tiles = std::min(line_tiles_, tile_count(g_.owidth, tile_, g_.dilation_x) - s.first_tile);
  const std::int64_t strips = divide_up(lines_, strip_lines_);
  s.image = index / strips;
  s.first_line = index % strips * strip_lines_;
  s.last_line = std::min(s.first_line + strip_lines_, lines_);
  s.panels = divide_up(s.tiles(), multiplier_.columns);
  s.panel_stride = words_ * multiplier_.columns;
  s.frequency_stride = strip_panels_ * s.panel_stride + kSkew;
  return s;
}

std::int64_t Conv2dWinogradBase::tasks_of(std::int64_t tile_panels) const noexcept {
  return divide_up(tile_panels, task_columns_) * divide_up(panels_, task_panels_);
}

/// Floats of a strip's transformed input.
std::int64_t Conv2dWinogradBase::v_size() const noexcept {
  return frequencies_ * (strip_panels_ * words_ * multiplier_.columns + kSkew);
}

/// Floats of a task's products: [panel of tiles][row][frequency][column].
std::int64_t Conv2dWinogradBase::products_size() const noexcept {
  return task_columns_ * task_panels_ * multiplier_.rows * product_row();
}

/// Floats for an input transform or a task: the products, then the sums of two filters and a row of each. All
/// may be read one vector beyond.
std::int64_t Conv2dWinogradBase::work_size() const noexcept {
  const std::int64_t sums = 2 * (tile_ + 1) * tile_ * phase_size_;
  return round_up(std::max(input_memory(g_, tile_, line_tiles_).total(tile_, lanes_),
                           products_size() + sums + 2 * kRowAlignment),
                  kRowAlignment);
}

std::size_t Conv2dWinogradBase::scratch_bytes() const noexcept {
  const std::int64_t most = shared_ ? std::max(tasks_of(strip_panels_), words_) : strips();
  const std::int64_t threads = std::min<std::int64_t>(thread_count(), most);
  const std::int64_t count = shared_ ? v_size() + threads * work_size() : threads * (v_size() + work_size());
  return static_cast<std::size_t>(count) * sizeof(float);
}

void Conv2dWinogradBase::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
  auto* memory = static_cast<float*>(static_cast<void*>(scratch.data()));
  const auto size = static_cast<std::int64_t>(scratch.size() / sizeof(float));
  if (shared_) {
    for (std::int64_t i = 0; i < strips(); ++i)
      run_strip(strip(i), arrays, memory, memory + v_size(), (size - v_size()) / work_size());
    return;
  }
  const std::int64_t thread = v_size() + work_size();
  std::atomic<std::int64_t> next{0};
  parallel_for(size / thread, [&](std::int64_t slot) {
    float* mine = memory + slot * thread;
    for (std::int64_t i = next++; i < strips(); i = next++)
      run_strip(strip(i), arrays, mine, mine + v_size(), 1);
  });
}

/// With `slots` threads, each with its part of memory. Within a thread of run(), with this one.
void Conv2dWinogradBase::run_strip(const Strip& strip, const Conv2dArrays& arrays, float* v, float* memory,
                                   std::int64_t slots) const {
  const float* x = arrays.x + strip.image * g_.ic * (upsampled_ ? g_.plane() / 4 : g_.plane());
  std::atomic<std::int64_t> next_word{0};
  parallel_for(slots, [&](std::int64_t slot) {
    for (std::int64_t k = next_word++; k < words_; k = next_word++)
      transform_channels(strip, k, x, v, memory + slot * work_size());
  });
  const std::int64_t tasks = tasks_of(strip.panels);
  std::atomic<std::int64_t> next_task{0};
  parallel_for(slots, [&](std::int64_t slot) {
    for (std::int64_t i = next_task++; i < tasks; i = next_task++)
      run_task(strip, i, arrays, v, memory + slot * work_size());
  });
}

/// Those of a word.
void Conv2dWinogradBase::transform_channels(const Strip& strip, std::int64_t word, const float* x, float* v,
                                            float* memory) const {
  const InputMemory sizes = input_memory(g_, tile_, line_tiles_);
  const std::int64_t start = tile_start(strip.first_tile, tile_, g_.dilation_x) - g_.left;
  const float* rows[kMaxLanes * 8];
  WinogradInput in{};
  in.rows = rows;
  in.used = (divide_up(strip.line_tiles, g_.dilation_x) * tile_ + 2) * g_.dilation_x;
  in.left = std::clamp<std::int64_t>(-start, 0, in.used);
  const std::int64_t first_column = std::clamp<std::int64_t>(start, 0, g_.width);
  in.count = std::min(in.used - in.left, g_.width - first_column);
  in.relu = relu_input_;
  in.doubled = upsampled_;
  in.odd = upsampled_ && first_column % 2 != 0;
  const std::int64_t repeats = upsampled_ ? 2 : 1;  // of each pixel, in both directions
  const std::int64_t width = g_.width / repeats, plane = width * (g_.height / repeats);
  const std::int64_t columns = (in.count + (in.odd ? 1 : 0) + repeats - 1) / repeats;  // that are read
  in.dilation = g_.dilation_x;
  in.tiles = strip.line_tiles;
  in.buffer = memory + sizes.zeros + round_up(in.left, kRowAlignment) - in.left;  // stores are aligned
  in.row_size = sizes.row_size;
  in.phases = memory + sizes.zeros + lanes_ * (tile_ + 2) * sizes.row_size;
  in.phase_size = sizes.phase_size;
  in.v = v + word * multiplier_.columns;
  in.columns = multiplier_.columns;
  in.panel_stride = strip.panel_stride;
  in.frequency_stride = strip.frequency_stride;
  std::fill_n(memory, in.count, 0.0F);
  for (std::int64_t line = strip.first_line; line < strip.last_line; ++line) {
    const std::int64_t top = tile_start(line, tile_, g_.dilation_y) - g_.top;
    for (std::int64_t lane = 0; lane < lanes_; ++lane) {
      const std::int64_t channel = word * lanes_ + lane;
      for (std::int64_t u = 0; u < tile_ + 2; ++u) {
        const std::int64_t row = top + u * g_.dilation_y;
        const bool inside = channel < g_.ic && row >= 0 && row < g_.height;
        rows[lane * (tile_ + 2) + u] =
            inside ? x + channel * plane + row / repeats * width + first_column / repeats : memory;
      }
    }
    in.first = (line - strip.first_line) * strip.line_tiles;
    for (std::int64_t lane = 0; lane < lanes_; ++lane)
      if ((word + 1) * lanes_ + lane < g_.ic)
        for (std::int64_t u = 2; u < tile_ + 2; ++u)
          if (const float* row = rows[lane * (tile_ + 2) + u]; row != memory)
            for (std::int64_t j = 0; j < columns; j += kCacheLine)
              __builtin_prefetch(row + lanes_ * plane + j);
    transforms_.input[static_cast<int>(precision_)](points_, in);
  }
}

void Conv2dWinogradBase::run_task(const Strip& strip, std::int64_t index, const Conv2dArrays& arrays,
                                  const float* v, float* memory) const {
  const std::int64_t rows = multiplier_.rows, columns = multiplier_.columns;
  const std::int64_t tasks = divide_up(strip.panels, task_columns_);  // that share weights
  const std::int64_t first_panel = index % tasks * task_columns_;
  const std::int64_t last_panel = std::min(first_panel + task_columns_, strip.panels);
  const std::int64_t first_filter = index / tasks * task_panels_;
  const std::int64_t last_filter = std::min(first_filter + task_panels_, panels_);
  const std::int64_t block = (last_filter - first_filter) * rows * product_row();  // of a panel of tiles
  const auto* u = static_cast<const float*>(static_cast<const void*>(arrays.packed));
  WinogradProduct p{};
  p.block = block_depth_;
  p.c_stride = product_row();
  p.row_count = std::min(last_filter * rows, g_.oc) - first_filter * rows;
  for (std::int64_t f = 0; f < frequencies_; ++f)
    for (std::int64_t k = 0; k < words_; k += part_depth_) {
      p.depth = std::min(part_depth_, words_ - k);
      p.add = k > 0;
      p.a = u + ((f * words_ + k) * panels_ + first_filter * p.depth) * rows;
      p.next_b = v + f * strip.frequency_stride + first_panel * strip.panel_stride + (k + p.depth) * columns;
      if (k + p.depth == words_) p.next_b += strip.frequency_stride - strip.panel_stride;
      for (std::int64_t panel = first_panel; panel < last_panel; ++panel) {
        p.b = v + f * strip.frequency_stride + panel * strip.panel_stride + k * columns;
        p.c = memory + (panel - first_panel) * block + f * columns;
        p.column_count = std::min(columns, strip.tiles() - panel * columns);
        multiplier_.multiply(p);
        p.next_b += (last_filter - first_filter) * p.depth * kCacheLine;
      }
    }
  float* sums = memory + products_size() + kRowAlignment;
  for (std::int64_t panel = first_panel; panel < last_panel; ++panel) {
    const std::int64_t end = std::min((panel + 1) * columns, strip.tiles());
    for (std::int64_t first = panel * columns; first < end;) {
      const std::int64_t line = first / strip.line_tiles;
      const std::int64_t last = std::min((line + 1) * strip.line_tiles, end);
      const std::int64_t offset = strip.first_tile - line * strip.line_tiles;
      transform_filters(
          {strip.image, tile_start(strip.first_line + line, tile_, g_.dilation_y), first + offset,
           last + offset, first_filter * rows, std::min(last_filter * rows, g_.oc)},
          memory + (panel - first_panel) * block + first % columns, arrays, sums);
      first = last;
    }
  }
  if (non_temporal_) non_temporal_fence();
}

}  // namespace slide::ops
