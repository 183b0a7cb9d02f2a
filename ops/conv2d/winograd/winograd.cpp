// A strip, some lines of tiles or a segment of one, is transformed channel by channel; then its tasks, some
// panels of tiles and of weights, multiply all frequencies one after the other into memory of their own, and
// transform the products back. What a thread writes and soon reads again, a task's products and, where there
// are strips enough for every thread to have its own, the transformed input, stays in the second-level cache;
// the weights stream from the third-level cache once for each task_columns_ panels of tiles. Few tiles have
// an order of their own (winograd_few_tiles.cpp).

#include "ops/conv2d/winograd/winograd.h"

#include <algorithm>
#include <cmath>

#include "ops/common/non_temporal.h"
#include "ops/conv2d/winograd/winograd_matrices.h"
#include "ops/conv2d/winograd/winograd_tiles.h"
#include "ops/simd/dispatch.h"
#include "runtime/threads.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)           \
  namespace level {                                \
  extern const WinogradRoutines winograd_routines; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

const WinogradRoutines& winograd_routines(Isa isa) {
#define SLIDE_LIST(level, enumerator) &level::winograd_routines,
  static const WinogradRoutines* const all[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  for (const WinogradRoutines* routines : all)
    if (runs_at(routines->isa, isa)) return *routines;
  return *all[std::size(all) - 1];
}

namespace {

constexpr std::int64_t kTaskTiles = 64;      // enough products for each weight that streams by
constexpr std::int64_t kTaskRows = 64;       // with kTaskTiles, 36 frequencies take 432 KiB
constexpr std::int64_t kMinTaskRows = 12;    // fewer read the transformed tiles too often
constexpr std::int64_t kFewTasks = 16;       // with fewer in a shared strip, tasks have fewer rows
constexpr std::int64_t kFewStrips = 8;       // with fewer, threads share them
constexpr std::int64_t kOwnBytes = 1 << 19;  // of a thread's own transformed input
constexpr std::int64_t kOwnTiles = 80;       // at least, even if they take more: panels are filled better
constexpr std::int64_t kNearBytes =
    24 << 10;  // of it, multiplied with all rows of a task: in the first-level cache
constexpr std::int64_t kSharedBytes = 8 << 20;
constexpr std::int64_t kMostSharedBytes = 64 << 20;  // rather than more, weights are read more often
constexpr std::int64_t kFilledEighths = 7;           // at least, of panels of filters as lanes
// Where it is worth it, as measured against direct convolution. Tiles that reach over the edge, or over that
// of a dilation's phase, multiply in vain.
constexpr std::int64_t kMinChannels = 16, kMinTiles2 = 16, kMinTiles = 24;
// Of fewer channels the transforms take most of the time: bfloat16 gains little there and errs more.
constexpr std::int64_t kMinChannelsBf16 = 24;
// As measured against integers.
constexpr std::int64_t kMinHarmonicChannels = 16, kMinTilesOfHarmonic = 128;
// So many weights come from memory, four times as many if they were transformed for large tiles: transformed
// by each run they take a few per cent more time, or, where they let tiles be large, less.
constexpr std::int64_t kLateWeights = 1 << 15, kMinTilesOfLate = 12, kMostTilesOfLate = 64;
// So many take 18 MiB for large tiles, 8 for small ones: more than few tiles are worth.
constexpr std::int64_t kManyWeights = 1 << 17, kMinTilesOfMany = 40;
// Of the products of a direct convolution. Where tiles save but a third, their weights must be transformed
// late, or not be many, but used often.
constexpr double kMostProducts2 = 0.6, kMostProducts = 0.4, kMostProductsOfFew = 0.65;
constexpr double kMostProducts2Bf16 = 0.5;
// Large tiles' products, of those of small ones: their weights take 2.25 times the memory.
constexpr double kMostProductsOf2 = 0.77;
// Frequencies are read and written together; at a distance of powers of two they would share a set of the
// cache.
constexpr std::int64_t kSkew = 16;
constexpr std::int64_t kMaxLanes = 2;
constexpr std::int64_t kChannelsAhead = 2;  // are fetched while one is transformed

std::int64_t divide_up(std::int64_t a, std::int64_t b) { return (a + b - 1) / b; }
std::int64_t round_up(std::int64_t a, std::int64_t b) { return divide_up(a, b) * b; }

std::int64_t tiles_of(int tile, const Conv2dGeometry& g) {
  return g.batch * tile_count(g.oheight, tile, g.dilation_y) * tile_count(g.owidth, tile, g.dilation_x);
}
/// Of a channel and a filter.
double products_of(int tile, const Conv2dGeometry& g) {
  return static_cast<double>(tiles_of(tile, g) * (tile + 2) * (tile + 2));
}

/// Of those of a direct convolution.
double share_of_products(int tile, const Conv2dGeometry& g) {
  return products_of(tile, g) / static_cast<double>(9 * g.batch * g.oplane());
}
/// Whether weights are transformed by each run, if filters fill the lanes.
bool is_late(int tile, const Conv2dGeometry& g) {
  return g.ic * g.oc >= kLateWeights && tiles_of(tile, g) <= kMostTilesOfLate;
}

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

Conv2dWinogradBase::Conv2dWinogradBase(int tile, Precision precision, const Conv2dRoutines& routines,
                                       const Conv2dGeometry& geometry, const Conv2dFusion& fusion)
    : routines_(routines),
      winograd_(winograd_routines(routines.isa)),
      multiplier_(winograd_.multipliers[static_cast<int>(precision)]),
      transforms_(transforms_of(tile, winograd_)),
      precision_(precision),
      upsampling_(fusion.upsample_input),
      joined_(fusion.joined),
      g_(geometry),
      gated_(fusion.gate),
      relu_input_(fusion.relu_input),
      finishes_rows_(finishes_rows(geometry, fusion, routines.isa)),
      non_temporal_(finishes_rows_ && fills_lines(geometry)),
      residual_last_(fusion.residual_last),
      few_tiles_(false),
      late_(false),
      shared_(false),
      epilogue_(finishes_rows_ ? without_residual(fusion) : fusion, routines.isa, finishes_rows_),
      tile_(tile),
      frequencies_((tile + 2) * (tile + 2)),
      points_(points_of(tile)),
      lanes_(lanes_of(precision)),
      words_(divide_up(g_.ic, lanes_)),
      block_depth_(block_depth_for(words_)),
      columns_(multiplier_.columns),
      panel_rows_(multiplier_.rows),
      part_depth_(std::max(kNearBytes / (columns_ * static_cast<std::int64_t>(sizeof(float))) / block_depth_,
                           std::int64_t{1}) *
                  block_depth_),
      lines_(tile_count(g_.oheight, tile, g_.dilation_y)),
      line_tiles_(tile_count(g_.owidth, tile, g_.dilation_x)),
      phase_size_(round_up(multiplier_.columns, kRowAlignment)),
      segments_(1),
      task_columns_(std::max<std::int64_t>(1, kTaskTiles / columns_)) {
  divide_tiles();
  choose_order();
}

/// Into strips.
void Conv2dWinogradBase::divide_tiles() noexcept {
  const auto tile_bytes = frequencies_ * words_ * static_cast<std::int64_t>(sizeof(float));
  const std::int64_t own = std::max(kOwnBytes / tile_bytes, kOwnTiles);
  shared_ = g_.batch * lines_ * line_tiles_ < kFewStrips * own;
  const std::int64_t shared = std::max(kSharedBytes / tile_bytes, 4 * kTaskTiles);
  const std::int64_t most =
      shared_ ? std::min(shared, std::max(kMostSharedBytes / tile_bytes, kTaskTiles)) : own;
  if (line_tiles_ > most) {
    const std::int64_t line = line_tiles_;
    // Segments of whole vectors: of a vector's tiles beyond the segment, products are computed in vain.
    line_tiles_ = round_up(round_up(divide_up(line, divide_up(line, most)), kRowAlignment), g_.dilation_x);
    segments_ = divide_up(line, line_tiles_);
  }
  strip_lines_ = segments_ > 1 ? 1 : std::clamp<std::int64_t>(most / line_tiles_, 1, lines_);
  strip_lines_ = divide_up(lines_, divide_up(lines_, strip_lines_));
}

void Conv2dWinogradBase::choose_order() noexcept {
  const std::int64_t tiles = strip_lines_ * line_tiles_;
  few_tiles_ = shared_ && tiles <= multiplier_.most_tiles &&
               8 * g_.oc >= kFilledEighths * round_up(g_.oc, multiplier_.filters);
  if (few_tiles_) {
    columns_ = std::min(columns_, round_up(divide_up(tiles, divide_up(tiles, columns_)), multiplier_.tiles));
    panel_rows_ = multiplier_.filters;
    part_depth_ = words_;
    late_ = strips() == 1 && g_.ic * g_.oc >= kLateWeights;
  }
  panels_ = divide_up(g_.oc, panel_rows_);
  strip_panels_ = divide_up(tiles, columns_);
  product_stride_ = few_tiles_ ? round_up(tiles, kRowAlignment) : columns_;
  product_row_ = frequencies_ * product_stride_ + (few_tiles_ ? kSkew : 0);
  std::int64_t rows = std::min(g_.oc, kTaskRows);
  if (shared_) {
    const std::int64_t runs = divide_up(kFewTasks, divide_up(strip_panels_, task_columns_));
    rows = std::clamp(divide_up(g_.oc, runs), std::min(rows, kMinTaskRows), rows);
  }
  task_panels_ = divide_up(rows, multiplier_.rows);
}

bool Conv2dWinogradBase::pays(int tile, const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  const bool possible = g.kheight == 3 && g.kwidth == 3 && g.stride_y == 1 && g.stride_x == 1 &&
                        g.groups == 1 && !(fusion.upsamples() && g.dilation_x != 1);
  if (!possible || g.ic < kMinChannels || g.oc < kMinChannels) return false;
  // A word holds channels of x or joined ones. Where integers would be faster, those lose more than is won.
  if (fusion.joined > 0 && ((g.ic - fusion.joined) % kMaxLanes != 0 || g.oc < kMinChannelsBf16 ||
                            !Conv2dWinogradBf16<4>::replaces_lower(g)))
    return false;
  const std::int64_t tiles = tiles_of(tile, g);
  const bool late = is_late(tile, g);
  if (tile == 2) {
    const bool few = late || (g.ic * g.oc < kManyWeights && tiles >= kMinTilesOfMany);
    return tiles >= kMinTiles2 && share_of_products(2, g) <= (few ? kMostProductsOfFew : kMostProducts2);
  }
  return tiles >= (late ? kMinTilesOfLate : kMinTiles) &&
         share_of_products(tile, g) <= (late ? kMostProductsOfFew : kMostProducts);
}

template <int Tile>
bool Conv2dWinograd<Tile>::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return pays(Tile, g, fusion) &&
         (Tile == 2 || !pays(2, g, fusion) || products_of(Tile, g) <= kMostProductsOf2 * products_of(2, g));
}
template <int Tile>
bool Conv2dWinograd<Tile>::beats_lower(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return fits(g, fusion) && share_of_products(Tile, g) <= kMostProducts;
}
template class Conv2dWinograd<2>;
template class Conv2dWinograd<4>;
template class Conv2dWinograd<6>;

template <int Tile>
bool Conv2dWinogradBf16<Tile>::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return pays(Tile, g, fusion) && std::min(g.ic, g.oc) >= kMinChannelsBf16 &&
         (Tile == 4 || is_late(Tile, g)) &&
         share_of_products(Tile, g) <= (Tile == 4 ? kMostProducts : kMostProducts2Bf16);
}
template <int Tile>
bool Conv2dWinogradBf16<Tile>::replaces_lower(const Conv2dGeometry& g) noexcept {
  return Tile == 4 && g.ic * g.oc >= kMinHarmonicChannels * (g.ic + g.oc) &&
         tiles_of(Tile, g) >= kMinTilesOfHarmonic;
}
template class Conv2dWinogradBf16<2>;
template class Conv2dWinogradBf16<4>;

double Conv2dWinogradBase::error_factor() const noexcept {
  const std::int64_t pairs = tile_ / 2;
  const std::int64_t fused = winograd_.fused ? 1 : 0;
  const std::int64_t blends = upsampling_ == Upsampling::kBilinear ? 1 : 0;  // in each direction
  const std::int64_t input = (pairs + blends) * (2 - fused);
  const bool rounded = precision_ == Precision::kBf16;
  const std::int64_t product =
      (rounded ? g_.ic : block_depth_ + divide_up(g_.ic, block_depth_)) + (1 - fused);
  const std::int64_t output = pairs + 1 + (1 - fused);
  const std::int64_t weight = rounded && late_ ? 6 : 1;  // float32: a product, two sums in each direction
  const auto roundings = static_cast<double>(2 * input + weight + product + 2 * output + 1);
  if (!rounded) return 1.001 * roundings;
  return (late_ ? 3.02 : 2.01) + 1.01 * roundings * 0x1p-16;
}

double Conv2dWinogradBase::macs() const noexcept {
  const std::int64_t tiles = g_.batch * lines_ * tile_count(g_.owidth, tile_, g_.dilation_x);
  return static_cast<double>(tiles * frequencies_) * static_cast<double>(g_.ic * g_.oc);
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
  s.panels = divide_up(s.tiles(), columns_);
  s.panel_stride = words_ * columns_;
  s.frequency_stride = strip_panels_ * s.panel_stride + kSkew;
  return s;
}

std::int64_t Conv2dWinogradBase::tasks_of(std::int64_t tile_panels) const noexcept {
  return divide_up(tile_panels, task_columns_) * divide_up(panels_, task_panels_);
}

/// Floats of a strip's transformed input.
std::int64_t Conv2dWinogradBase::v_size() const noexcept {
  return frequencies_ * (strip_panels_ * words_ * columns_ + kSkew);
}

/// Floats of a task's products: [panel of tiles][row][frequency][column]; or, if tiles are few, of all
/// products: [row][frequency][tile].
std::int64_t Conv2dWinogradBase::products_size() const noexcept {
  if (few_tiles_) return panels_ * panel_rows_ * product_row_ + kRowAlignment;
  return task_columns_ * task_panels_ * panel_rows_ * product_row_;
}

/// Floats for an input transform or a task: the products, then the sums of two filters and a row of each. All
/// may be read one vector beyond.
std::int64_t Conv2dWinogradBase::work_size() const noexcept {
  const std::int64_t sums = 2 * (tile_ + 1) * tile_ * phase_size_;
  std::int64_t products = products_size() + sums;
  if (few_tiles_) products = late_ ? late_size() : panel_rows_ * product_stride_;
  return round_up(std::max({input_memory(g_, tile_, line_tiles_).total(tile_, lanes_),
                            products + 2 * kRowAlignment, sums + 2 * kRowAlignment}),
                  kRowAlignment);
}

std::size_t Conv2dWinogradBase::scratch_bytes() const noexcept {
  const std::int64_t tasks = few_tiles_ ? std::max(frequencies_, g_.oc) : tasks_of(strip_panels_);
  const std::int64_t most = shared_ ? std::max(tasks, words_) : strips();
  const std::int64_t threads = std::min<std::int64_t>(thread_count(), most);
  const std::int64_t count =
      shared_ ? shared_size() + threads * work_size() : threads * (v_size() + work_size());
  return static_cast<std::size_t>(count) * sizeof(float);
}

void Conv2dWinogradBase::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
  auto* memory = static_cast<float*>(static_cast<void*>(scratch.data()));
  const auto size = static_cast<std::int64_t>(scratch.size() / sizeof(float));
  if (shared_) {
    for (std::int64_t i = 0; i < strips(); ++i)
      run_strip(strip(i), arrays, memory, memory + shared_size(), (size - shared_size()) / work_size());
    return;
  }
  const std::int64_t thread = v_size() + work_size();
  parallel_for(strips(), size / thread, [&](std::int64_t i, std::int64_t slot) {
    float* mine = memory + slot * thread;
    run_strip(strip(i), arrays, mine, mine + v_size(), 1);
  });
}

/// With `slots` threads, each with its part of memory. Within a thread of run(), with this one.
void Conv2dWinogradBase::run_strip(const Strip& strip, const Conv2dArrays& arrays, float* v, float* memory,
                                   std::int64_t slots) const {
  const std::int64_t size = work_size();
  parallel_for(words_, slots, [&](std::int64_t k, std::int64_t slot) {
    transform_channels(strip, k, arrays, v, memory + slot * size);
  });
  if (few_tiles_) return run_few_tiles(strip, arrays, v, v + v_size(), memory, slots);
  parallel_for(tasks_of(strip.panels), slots, [&](std::int64_t i, std::int64_t slot) {
    run_task(strip, i, arrays, v, memory + slot * size);
  });
}

/// Those of a word, all of x or all joined.
void Conv2dWinogradBase::transform_channels(const Strip& strip, std::int64_t word, const Conv2dArrays& arrays,
                                            float* v, float* memory) const {
  const bool joined = word * lanes_ >= g_.ic - joined_;
  const Upsampling upsampling = joined ? Upsampling::kNone : upsampling_;
  const std::int64_t channels = joined ? joined_ : g_.ic - joined_;
  const std::int64_t first_channel = word * lanes_ - (joined ? g_.ic - joined_ : 0);
  const InputMemory sizes = input_memory(g_, tile_, line_tiles_);
  const std::int64_t start = tile_start(strip.first_tile, tile_, g_.dilation_x) - g_.left;
  const float *rows[kMaxLanes * 8], *far_rows[kMaxLanes * 8];
  WinogradInput in{};
  in.rows = rows;
  in.far_rows = far_rows;
  in.used = (divide_up(strip.line_tiles, g_.dilation_x) * tile_ + 2) * g_.dilation_x;
  in.left = std::clamp<std::int64_t>(-start, 0, in.used);
  const std::int64_t first_column = std::clamp<std::int64_t>(start, 0, g_.width);
  in.count = std::min(in.used - in.left, g_.width - first_column);
  in.relu = relu_input_;
  in.doubled = upsampling == Upsampling::kNearest;
  in.blended = upsampling == Upsampling::kBilinear;
  const int halved = upsampling == Upsampling::kNone ? 0 : 1;  // both sides, by shifts: divisions are slow
  const std::int64_t width = g_.width >> halved, height = g_.height >> halved;
  in.odd = halved != 0 && first_column % 2 != 0;
  std::int64_t first_read = first_column >> halved;
  std::int64_t last_read = (first_column + in.count + halved) >> halved;
  in.left_edge = first_read == 0;
  in.right_edge = last_read == width;
  if (in.blended) {
    first_read -= in.left_edge ? 0 : 1;
    last_read += in.right_edge ? 0 : 1;
  }
  const std::int64_t plane = width * height, columns = last_read - first_read;
  const float* x = (joined ? arrays.joined : arrays.x) + strip.image * channels * plane;
  in.dilation = g_.dilation_x;
  in.tiles = strip.line_tiles;
  in.buffer = memory + sizes.zeros + round_up(in.left, kRowAlignment) - in.left;  // stores are aligned
  in.row_size = sizes.row_size;
  in.phases = memory + sizes.zeros + lanes_ * (tile_ + 2) * sizes.row_size;
  in.phase_size = sizes.phase_size;
  in.v = v + word * columns_;
  in.columns = columns_;
  in.panel_stride = strip.panel_stride;
  in.frequency_stride = strip.frequency_stride;
  in.ahead = first_channel + lanes_ + kChannelsAhead <= channels ? kChannelsAhead * plane : 0;
  std::fill_n(memory, columns, 0.0F);
  for (std::int64_t line = strip.first_line; line < strip.last_line; ++line) {
    const std::int64_t top = tile_start(line, tile_, g_.dilation_y) - g_.top;
    for (std::int64_t lane = 0; lane < lanes_; ++lane) {
      const std::int64_t channel = first_channel + lane;
      for (std::int64_t u = 0; u < tile_ + 2; ++u) {
        const std::int64_t row = top + u * g_.dilation_y;
        const bool inside = channel < channels && row >= 0 && row < g_.height;
        const std::int64_t near = row >> halved;
        const std::int64_t far = std::clamp<std::int64_t>(near + (row % 2 == 0 ? -1 : 1), 0, height - 1);
        const float* from = x + channel * plane + first_read;
        rows[lane * (tile_ + 2) + u] = inside ? from + near * width : memory;
        far_rows[lane * (tile_ + 2) + u] = inside ? from + far * width : memory;
      }
    }
    in.first = (line - strip.first_line) * strip.line_tiles;
    transforms_.input[static_cast<int>(precision_)](points_, in);
  }
}

void Conv2dWinogradBase::run_task(const Strip& strip, std::int64_t index, const Conv2dArrays& arrays,
                                  const float* v, float* memory) const {
  const std::int64_t tasks = divide_up(strip.panels, task_columns_);  // that share weights
  const std::int64_t first_panel = index % tasks * task_columns_;
  const std::int64_t last_panel = std::min(first_panel + task_columns_, strip.panels);
  const std::int64_t first_filter = index / tasks * task_panels_;
  const std::int64_t last_filter = std::min(first_filter + task_panels_, panels_);
  const std::int64_t block =
      (last_filter - first_filter) * panel_rows_ * product_row_;  // of a panel of tiles
  const auto* u = static_cast<const float*>(static_cast<const void*>(arrays.packed));
  WinogradProduct p{};
  p.block = block_depth_;
  p.c_stride = product_row_;
  p.row_count = std::min(last_filter * panel_rows_, g_.oc) - first_filter * panel_rows_;
  for (std::int64_t f = 0; f < frequencies_; ++f)
    for (std::int64_t k = 0; k < words_; k += part_depth_) {
      p.depth = std::min(part_depth_, words_ - k);
      p.add = k > 0;
      p.a = u + ((f * words_ + k) * panels_ + first_filter * p.depth) * panel_rows_;
      p.next_b = v + f * strip.frequency_stride + first_panel * strip.panel_stride + (k + p.depth) * columns_;
      if (k + p.depth == words_) p.next_b += strip.frequency_stride - strip.panel_stride;
      for (std::int64_t panel = first_panel; panel < last_panel; ++panel) {
        p.b = v + f * strip.frequency_stride + panel * strip.panel_stride + k * columns_;
        p.c = memory + (panel - first_panel) * block + f * product_stride_;
        p.column_count = std::min(columns_, strip.tiles() - panel * columns_);
        p.ahead = k == 0 ? residual_ahead(strip, panel, first_filter * panel_rows_, f, arrays) : nullptr;
        p.ahead_lines = p.ahead != nullptr ? columns_ * tile_ / kCacheLine : 0;
        p.ahead_stride = p.ahead != nullptr ? panel_rows_ * g_.oplane() : 0;
        multiplier_.multiply(p);
        p.next_b += (last_filter - first_filter) * p.depth * kCacheLine;
      }
    }
  float* sums = memory + products_size() + kRowAlignment;
  for (std::int64_t panel = first_panel; panel < last_panel; ++panel)
    transform_panel(strip, panel, first_filter * panel_rows_, std::min(last_filter * panel_rows_, g_.oc),
                    memory + (panel - first_panel) * block, arrays, sums);
  if (non_temporal_) non_temporal_fence();
}

/// Of a large residual, what to fetch into the second-level cache while a panel of tiles is multiplied with
/// the filters from first_filter on at a frequency: of each panel of filters one filter's row of the tiles,
/// so that all have come when they are transformed back. Null if there is nothing.
const float* Conv2dWinogradBase::residual_ahead(const Strip& strip, std::int64_t panel,
                                                std::int64_t first_filter, std::int64_t frequency,
                                                const Conv2dArrays& arrays) const {
  const std::int64_t row_of_tiles = frequency / panel_rows_, first = panel * columns_;
  if (arrays.residual == nullptr || !non_temporal_ || row_of_tiles >= tile_) return nullptr;
  const std::int64_t line = strip.first_line + first / strip.line_tiles;
  const std::int64_t row = tile_start(line, tile_, g_.dilation_y) + row_of_tiles * g_.dilation_y;
  if (row >= g_.oheight) return nullptr;
  const std::int64_t filter = strip.image * g_.oc + first_filter + frequency % panel_rows_;
  return arrays.residual + filter * g_.oplane() + row * g_.owidth +
         (strip.first_tile + first % strip.line_tiles) * tile_;
}

/// The results of one panel of tiles.
void Conv2dWinogradBase::transform_panel(const Strip& strip, std::int64_t panel, std::int64_t first_filter,
                                         std::int64_t last_filter, const float* products,
                                         const Conv2dArrays& arrays, float* sums) const {
  const std::int64_t end = std::min((panel + 1) * columns_, strip.tiles());
  for (std::int64_t first = panel * columns_; first < end;) {
    const std::int64_t line = first / strip.line_tiles;
    const std::int64_t last = std::min((line + 1) * strip.line_tiles, end);
    const std::int64_t offset = strip.first_tile - line * strip.line_tiles;
    transform_filters({strip.image, tile_start(strip.first_line + line, tile_, g_.dilation_y), first + offset,
                       last + offset, first_filter, last_filter},
                      products + first % columns_, arrays, sums);
    first = last;
  }
}

}  // namespace slide::ops
