// What a direct convolution decides before it runs: what is gathered, and how the work is parted.

#include "ops/conv2d/direct/direct.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "ops/conv2d/few_filters/few_filters.h"
#include "ops/conv2d/winograd/winograd.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kTaskPositions = 96;  // the weights are read once for them
// Words of kTaskPositions: most of the first-level cache, which is larger where AVX-512 is. Deeper blocks
// round more often.
constexpr std::int64_t kGatheredDepth = 64, kSmallGatheredDepth = 32;
constexpr std::int64_t kTileDepth = 96;        // with tiles, whose sums round less
constexpr std::int64_t kExactDepth = 320;      // of integers in rows: rows of that many words, too
constexpr std::int64_t kStreamedDepth = 160;   // at most, where a sum in order has that many roundings
constexpr std::int64_t kFewPanels = 2;         // gathering costs as much as half of one
constexpr std::int64_t kLocalWords = 1 << 17;  // planes of a task: half of the second-level cache or less
constexpr std::int64_t kLocalPanels = 8;       // with more, what lies farther away is read seldom
// x as large is not in the second-level cache. It is fetched where products take long enough: deep ones, of
// many panels, but not of integers, four rows of which become one.
constexpr std::int64_t kFarNumbers = 1 << 18, kFarChannels = 64, kFetchingPanels = 8;
constexpr std::int64_t kStripPositions = 4096;
constexpr std::int64_t kFewTasks = 8;  // with fewer, output channels are split, too
constexpr std::int64_t kMinTaskPanels = 8;

std::int64_t divide_up(std::int64_t a, std::int64_t b) { return (a + b - 1) / b; }
std::int64_t aligned(std::int64_t count) { return divide_up(count, kRowAlignment) * kRowAlignment; }

/// `whole` in equal parts of at most `most`.
std::int64_t equal_part(std::int64_t whole, std::int64_t most) {
  return divide_up(whole, divide_up(whole, std::max<std::int64_t>(1, most)));
}

/// Blocks of about the root of the depth make the fewest roundings.
std::int64_t gathered_depth(std::int64_t depth, Isa isa) {
  const bool avx512 = runs_at(Isa::kAvx512, isa);
  const std::int64_t least = avx512 ? kGatheredDepth : kSmallGatheredDepth;
  const auto root = static_cast<std::int64_t>(std::sqrt(static_cast<double>(depth)));
  return equal_part(depth, std::max(least, root));
}

bool upsamples_3x3(const Conv2dGeometry& g, const Conv2dFusion& fusion) {
  return fusion.upsample_input == Upsampling::kNearest && g.kheight == 3 && g.kwidth == 3 &&
         g.stride_y == 1 && g.stride_x == 1 && g.dilation_y == 1 && g.dilation_x == 1 && g.top == 1 &&
         g.left == 1 && g.oheight == g.height && g.owidth == g.width;
}

bool possible(const Conv2dGeometry& g, const Conv2dFusion& fusion) {
  constexpr std::int64_t kLargest = std::numeric_limits<std::int32_t>::max();  // of an offset
  const std::int64_t padded = (g.oheight + g.kheight * g.dilation_y) * (g.owidth + g.kwidth * g.dilation_x);
  return !(fusion.gate && g.groups > 1) && (!fusion.upsamples() || upsamples_3x3(g, fusion)) &&
         g.group_ic * g.stride_y * g.stride_x < kLargest / padded;
}

/// A residual is added to the sums in registers unless something but a cut comes between.
Conv2dFusion after_the_sums(Conv2dFusion fusion) {
  const bool function = fusion.residual_last && fusion.activation && !only_cuts(*fusion.activation);
  const bool between = fusion.gate || fusion.upsamples() || function;
  fusion.residual = fusion.residual && between;
  return fusion;
}

/// Whether x can stand for its planes: no padding, one tap.
bool reads_inside(const Conv2dGeometry& g) {
  return g.kheight == 1 && g.kwidth == 1 && g.top == 0 && g.left == 0 &&
         (g.oheight - 1) * g.stride_y < g.height && (g.owidth - 1) * g.stride_x < g.width;
}

}  // namespace

bool Conv2dDirect::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return possible(g, fusion);
}

bool Conv2dDirectBf16::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return possible(g, fusion) && g.group_ic >= 2 && !Conv2dFewFilters::beats_lower(g, fusion) &&
         !Conv2dWinograd<4>::beats_lower(g, fusion);
}

bool Conv2dDirectBf16::fits_tiles(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return Conv2dDirectLow::fits(g, fusion) && g.group_ic >= 2 && !Conv2dFewFilters::beats_lower(g, fusion);
}

Conv2dDirect::Conv2dDirect(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                           const Conv2dFusion& fusion, Precision precision)
    : routines_(routines),
      g_(with_rows_joined(geometry)),
      precision_(precision),
      gated_(fusion.gate),
      upsampled_(fusion.upsamples()),
      relu_input_(fusion.relu_input),
      residual_last_(fusion.residual_last),
      least_(relu_input_ ? 0.0F : -std::numeric_limits<float>::infinity()),
      epilogue_(after_the_sums(fusion), routines.isa, true),
      in_height_(upsampled_ ? g_.height / 2 : g_.height),
      in_width_(upsampled_ ? g_.width / 2 : g_.width),
      rows_out_(upsampled_ ? in_height_ : g_.oheight),
      columns_out_(upsampled_ ? in_width_ : g_.owidth),
      taps_(upsampled_ ? 4 : g_.kheight * g_.kwidth),
      lanes_(lanes_of(precision)),
      group_words_(divide_up(g_.group_ic, lanes_)),
      depth_(group_words_ * taps_),
      block_depth_(gathered_depth(depth_, routines.isa)),
      panels_(divide_up(g_.group_oc, routines.rows)),
      variants_(upsampled_ ? 4 : 1),
      in_place_(!upsampled_ && reads_inside(g_)),
      reach_y_(upsampled_ ? 2 : (g_.kheight - 1) * g_.dilation_y / g_.stride_y),
      plane_width_(columns_out_ + (upsampled_ ? 2 : (g_.kwidth - 1) * g_.dilation_x / g_.stride_x)) {
  const bool full_vectors = panels_ == 1 ? aligned(columns_out_) <= columns_out_ * 2
                                         : aligned(columns_out_) * 4 <= columns_out_ * 5;
  const bool as_it_is =
      precision == Precision::kFp32 && !relu_input_ && reads_once(g_) && columns_out_ % kRowAlignment == 0;
  const bool tiles = routines.tile_depth > 1;
  if (tiles) block_depth_ = filled(equal_part(depth_, kTileDepth));
  streaming_ = !tiles && panels_ <= kFewPanels && !upsampled_ && (in_place_ ? as_it_is : full_vectors);
  const std::int64_t idle = aligned(columns_out_) - columns_out_;
  const bool wide = 3 * columns_out_ >= 2 * routines_.columns && idle * panels_ <= columns_out_;
  in_rows_ = streaming_ || (!tiles && !in_place_ && wide);
  if (in_rows_ && precision == Precision::kInt8) block_depth_ = equal_part(depth_, kExactDepth);
  const bool far = g_.ic * g_.plane() >= kFarNumbers && g_.ic >= kFarChannels && panels_ >= kFetchingPanels;
  fetches_ = in_place_ && g_.stride_x == 1 && g_.stride_y == 1 && precision != Precision::kInt8 && far;
  choose_tasks();
  list_offsets();
}

void Conv2dDirect::choose_tasks() {
  const std::int64_t groups = g_.batch * g_.groups;
  const std::int64_t phases = g_.stride_y * g_.stride_x;
  const std::int64_t columns = routines_.columns;
  const std::int64_t tile = std::clamp<std::int64_t>(kTaskPositions / columns, 1, kTilePanels) * columns;
  strip_rows_ = std::clamp(kStripPositions / plane_width_, std::min(4 * reach_y_ + 1, rows_out_), rows_out_);
  if (groups < kFewTasks)
    strip_rows_ = std::clamp(rows_out_ * groups / kFewTasks,
                             std::min(strip_rows_, divide_up(tile, columns_out_)), strip_rows_);
  const std::int64_t fitting = kLocalWords / (group_words_ * phases * plane_width_) - reach_y_;
  const bool shorter = !in_place_ && !upsampled_ && !streaming_ && panels_ <= kLocalPanels;
  if (shorter && fitting > 2 * reach_y_) strip_rows_ = std::min(strip_rows_, fitting);
  strip_rows_ = equal_part(rows_out_, strip_rows_);
  const std::int64_t word_size = phases * (strip_rows_ + reach_y_) * plane_width_;
  const bool small =
      group_words_ * word_size <= kLocalWords && groups * divide_up(rows_out_, strip_rows_) >= kFewTasks;
  local_ = !in_place_ && (streaming_ || (small && !upsampled_));
  if (!local_) strip_rows_ = rows_out_;
  if (streaming_ && local_)
    block_depth_ =
        taps_ * equal_part(group_words_, std::min(kLocalWords / word_size, kStreamedDepth / taps_));
  strips_ = divide_up(rows_out_, strip_rows_);
  // Neighbouring planes begin an odd number of cache lines apart: they fall into different sets.
  plane_size_ = aligned((strip_rows_ + reach_y_) * plane_width_);
  if (plane_size_ / kRowAlignment % 2 == 0) plane_size_ += kRowAlignment;

  const std::int64_t positions = strip_rows_ * columns_out_;
  tile_positions_ = std::min(tile, divide_up(positions, columns) * columns);
  task_positions_ = streaming_ ? std::min(8 * tile, divide_up(positions, columns) * columns)
                    : in_rows_ ? divide_up(tile, columns_out_) * columns_out_
                               : tile_positions_;
  tiles_ = local_ ? 1 : divide_up(positions, task_positions_);
  task_panels_ = panels_;
  const std::int64_t tasks = groups * variants_ * strips_ * tiles_;
  if (!local_ && tasks > 0 && tasks < kFewTasks)
    task_panels_ = std::clamp(panels_ * tasks / kFewTasks, std::min(kMinTaskPanels, panels_), panels_);
  row_tasks_ = divide_up(panels_, task_panels_);
}

void Conv2dDirect::list_offsets() {
  const std::int64_t phases = g_.stride_y * g_.stride_x;
  phase_is_read_.assign(static_cast<std::size_t>(phases), 0);
  offsets_.resize(static_cast<std::size_t>(variants_ * depth_));
  for (int variant = 0; variant < variants_; ++variant)
    for (std::int64_t tap = 0; tap < taps_; ++tap) {
      const std::int64_t y = upsampled_ ? variant / 2 + tap / 2 : tap / g_.kwidth * g_.dilation_y;
      const std::int64_t x = upsampled_ ? variant % 2 + tap % 2 : tap % g_.kwidth * g_.dilation_x;
      const std::int64_t phase = y % g_.stride_y * g_.stride_x + x % g_.stride_x;
      phase_is_read_[static_cast<std::size_t>(phase)] = 1;
      const std::int64_t in_planes = phase * plane_size_ + y / g_.stride_y * plane_width_ + x / g_.stride_x;
      const std::int64_t first = in_place_ ? 0 : in_planes;
      const std::int64_t step = in_place_ ? lanes_ * g_.plane() : phases * plane_size_;
      std::int32_t* to = offsets_.data() + variant * depth_ + tap;
      for (std::int64_t word = 0; word < group_words_; ++word)
        to[word * taps_] = static_cast<std::int32_t>(first + word * step);
    }
}

double Conv2dDirect::error_factor() const noexcept {
  if (precision_ == Precision::kInt8) return 1;
  const std::int64_t blocks = divide_up(depth_, block_depth_);
  // Each word is as many fused multiply-adds; sums of weights (upsampled) are rounded once more.
  const auto roundings =
      static_cast<double>(block_depth_ * lanes_ + blocks + (routines_.fused ? 0 : 1) + (upsampled_ ? 1 : 0));
  // Rounded to odd, two products are added and then their sum: half as many roundings and one, of two units each.
  const double to_odd = routines_.rounds_to_odd ? 2 : 0;
  if (precision_ == Precision::kBf16) return 2.01 + 1.01 * (roundings + to_odd) * 0x1p-16;
  return 1.001 * roundings;
}

double Conv2dDirect::macs() const noexcept {
  return static_cast<double>(g_.batch * g_.oc * g_.oplane()) * static_cast<double>(g_.group_ic * taps_);
}

std::int64_t Conv2dDirect::task_count() const noexcept {
  return g_.batch * g_.groups * variants_ * strips_ * tiles_ * row_tasks_;
}

/// The words that a depth takes where whole tiles are multiplied.
std::int64_t Conv2dDirect::filled(std::int64_t depth) const noexcept {
  return divide_up(depth, routines_.tile_depth) * routines_.tile_depth;
}

/// The words of a task's planes, and what whole vectors read behind them.
std::int64_t Conv2dDirect::strip_planes() const noexcept {
  if (!local_) return 0;
  const std::int64_t words = streaming_ ? block_depth_ / taps_ : group_words_;
  return words * g_.stride_y * g_.stride_x * plane_size_ + aligned(routines_.columns);
}

std::int64_t Conv2dDirect::shared_planes() const noexcept {
  if (local_ || in_place_) return 0;
  return g_.batch * g_.groups * group_words_ * g_.stride_y * g_.stride_x * plane_size_ + kRowAlignment;
}

std::int64_t Conv2dDirect::rows_size() const noexcept {
  return aligned(variants_ * g_.groups * panels_ * routines_.rows);
}

/// A task's planes, gathered words, sums.
std::int64_t Conv2dDirect::thread_size() const noexcept {
  const std::int64_t rows = task_panels_ * routines_.rows;
  if (!streaming_)
    return strip_planes() + ((in_rows_ ? 0 : block_depth_) + rows) * tile_positions_ + kRowAlignment;
  const std::int64_t columns = aligned(routines_.columns);
  const std::int64_t row_columns = divide_up(columns_out_, routines_.columns) * columns;
  return strip_planes() + rows * (local_ ? strip_rows_ * row_columns : task_positions_);
}

std::size_t Conv2dDirect::scratch_bytes() const noexcept {
  const std::int64_t threads = std::min<std::int64_t>(thread_count(), task_count());
  return static_cast<std::size_t>(3 * rows_size() + shared_planes() + threads * thread_size()) *
         sizeof(float);
}

Conv2dDirect::Task Conv2dDirect::task(std::int64_t index) const noexcept {
  Task t{};
  const std::int64_t run = index % row_tasks_;
  index /= row_tasks_;
  t.first_panel = run * task_panels_;
  t.last_panel = std::min(t.first_panel + task_panels_, panels_);
  t.first = index % tiles_ * task_positions_;
  index /= tiles_;
  t.first_row = index % strips_ * strip_rows_;
  index /= strips_;
  const std::int64_t positions = std::min(strip_rows_, rows_out_ - t.first_row) * columns_out_;
  t.count = local_ ? positions : std::min(task_positions_, positions - t.first);
  t.variant = static_cast<int>(index % variants_);
  index /= variants_;
  t.group = index % g_.groups;
  t.image = index / g_.groups;
  return t;
}

/// The columns that a panel at `first` has: where it must not leave its row, the last two are about equal.
std::int64_t Conv2dDirect::panel_columns(std::int64_t first, std::int64_t last) const noexcept {
  const std::int64_t most = routines_.columns;
  if (!in_rows_) return std::min(most, last - first);
  const std::int64_t rest = std::min(columns_out_ - first % columns_out_, last - first);
  return rest >= 2 * most || rest <= most ? std::min(most, rest) : std::min(most, aligned((rest + 1) / 2));
}

}  // namespace slide::ops
