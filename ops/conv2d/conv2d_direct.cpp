#include "ops/conv2d/conv2d_direct.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include "ops/conv2d/conv2d_winograd.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kTaskPositions = 96;  // gathered: the weights are read once for them
// Words of kTaskPositions: most of the first-level cache, which is larger where AVX-512 is. Deeper blocks
// round more often.
constexpr std::int64_t kGatheredDepth = 64, kSmallGatheredDepth = 32;
constexpr std::int64_t kStreamedDepth = 160;   // at most, where a sum in order has that many roundings
constexpr std::int64_t kFewPanels = 2;         // gathering costs as much as half of one
constexpr std::int64_t kLocalWords = 3 << 15;  // planes of a task: part of the second-level cache
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
  const bool avx512 = isa == Isa::kAvx512 || isa == Isa::kAvx512Bf16;
  const std::int64_t least = avx512 ? kGatheredDepth : kSmallGatheredDepth;
  const auto root = static_cast<std::int64_t>(std::sqrt(static_cast<double>(depth)));
  return equal_part(depth, std::max(least, root));
}

std::int64_t lanes_of(Precision precision) {
  switch (precision) {
    case Precision::kBf16:
      return 2;
    case Precision::kInt8:
      return 4;
    default:
      return 1;
  }
}

bool upsamples_3x3(const Conv2dGeometry& g) {
  return g.kheight == 3 && g.kwidth == 3 && g.stride_y == 1 && g.stride_x == 1 && g.dilation_y == 1 &&
         g.dilation_x == 1 && g.top == 1 && g.left == 1 && g.oheight == g.height && g.owidth == g.width;
}

bool possible(const Conv2dGeometry& g, const Conv2dFusion& fusion) {
  constexpr std::int64_t kLargest = std::numeric_limits<std::int32_t>::max();  // of an offset
  const std::int64_t padded = (g.oheight + g.kheight * g.dilation_y) * (g.owidth + g.kwidth * g.dilation_x);
  return !(fusion.gate && g.groups > 1) && (!fusion.upsample_input || upsamples_3x3(g)) &&
         g.group_ic * g.stride_y * g.stride_x < kLargest / padded;
}

/// A residual is added to the sums in registers unless something but a cut comes between.
Conv2dFusion after_the_sums(Conv2dFusion fusion) {
  const bool function = fusion.residual_last && fusion.activation && !only_cuts(*fusion.activation);
  const bool between = fusion.gate || fusion.upsample_input || function;
  fusion.residual = fusion.residual && between;
  return fusion;
}

/// Whether x can stand for its planes: no padding, one tap.
bool reads_inside(const Conv2dGeometry& g) {
  return g.kheight == 1 && g.kwidth == 1 && g.top == 0 && g.left == 0 &&
         (g.oheight - 1) * g.stride_y < g.height && (g.owidth - 1) * g.stride_x < g.width;
}

}  // namespace

struct Conv2dDirect::Task {
  std::int64_t image, group;
  int variant;
  std::int64_t first_panel, last_panel;  // of weights
  std::int64_t first_row;                // of the strip
  std::int64_t first, count;             // positions in the strip
};

bool Conv2dDirect::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return possible(g, fusion);
}

bool Conv2dDirectBf16::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return possible(g, fusion) && g.group_ic >= 2 && !Conv2dWinograd<4>::fits(g, fusion);
}

bool Conv2dDirectInt8::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return possible(g, fusion) && g.group_ic >= 8;
}

Conv2dDirect::Conv2dDirect(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                           const Conv2dFusion& fusion, Precision precision)
    : routines_(routines),
      g_(with_rows_joined(geometry)),
      precision_(precision),
      gated_(fusion.gate),
      upsampled_(fusion.upsample_input),
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
  streaming_ = panels_ <= kFewPanels && !upsampled_ && (in_place_ ? as_it_is : full_vectors);
  choose_tasks();
  list_offsets();
}

void Conv2dDirect::choose_tasks() {
  const std::int64_t groups = g_.batch * g_.groups;
  const std::int64_t phases = g_.stride_y * g_.stride_x;
  const std::int64_t columns = routines_.columns;
  const std::int64_t tile = std::max<std::int64_t>(1, kTaskPositions / columns) * columns;
  strip_rows_ = std::clamp(kStripPositions / plane_width_, std::min(4 * reach_y_ + 1, rows_out_), rows_out_);
  if (groups < kFewTasks)
    strip_rows_ = std::clamp(rows_out_ * groups / kFewTasks,
                             std::min(strip_rows_, divide_up(tile, columns_out_)), strip_rows_);
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
  task_positions_ = std::min((streaming_ ? 8 : 1) * tile, divide_up(positions, columns) * columns);
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
  for (int variant = 0; variant < variants_; ++variant)
    for (std::int64_t k = 0; k < depth_; ++k) {
      const std::int64_t tap = k % taps_;
      const std::int64_t y = upsampled_ ? variant / 2 + tap / 2 : tap / g_.kwidth * g_.dilation_y;
      const std::int64_t x = upsampled_ ? variant % 2 + tap % 2 : tap % g_.kwidth * g_.dilation_x;
      const std::int64_t phase = y % g_.stride_y * g_.stride_x + x % g_.stride_x;
      phase_is_read_[static_cast<std::size_t>(phase)] = 1;
      const std::int64_t in_planes =
          (k / taps_ * phases + phase) * plane_size_ + y / g_.stride_y * plane_width_ + x / g_.stride_x;
      offsets_.push_back(static_cast<std::int32_t>(in_place_ ? k * lanes_ * g_.plane() : in_planes));
    }
}

double Conv2dDirect::error_factor() const noexcept {
  if (precision_ == Precision::kInt8) return 1;
  const std::int64_t blocks = divide_up(depth_, block_depth_);
  // Each word is as many fused multiply-adds; sums of weights (upsampled) are rounded once more.
  const auto roundings =
      static_cast<double>(block_depth_ * lanes_ + blocks + (routines_.fused ? 0 : 1) + (upsampled_ ? 1 : 0));
  if (precision_ == Precision::kBf16) return 2.01 + 1.01 * roundings * 0x1p-16;
  return 1.001 * roundings;
}

double Conv2dDirect::macs() const noexcept {
  return static_cast<double>(g_.batch * g_.oc * g_.oplane()) * static_cast<double>(g_.group_ic * taps_);
}

std::int64_t Conv2dDirect::task_count() const noexcept {
  return g_.batch * g_.groups * variants_ * strips_ * tiles_ * row_tasks_;
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
  if (!streaming_) return strip_planes() + (block_depth_ + rows) * task_positions_ + kRowAlignment;
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

/// Whether nothing is left to do after the sums but what the product does: then it writes to y.
bool Conv2dDirect::writes_y() const noexcept { return !gated_ && !upsampled_ && epilogue_.empty(nullptr); }

/// Words k, ... of a panel of weights times positions that fill at most one panel of columns.
void Conv2dDirect::multiply(const Call& call, const Task& t, std::int64_t panel, std::int64_t k,
                            std::int64_t first, std::int64_t count, const float* b, float* sums) const {
  const std::int64_t rows = routines_.rows;
  const std::int64_t depth = std::min(block_depth_, depth_ - k);
  const std::int64_t group = t.variant * g_.groups + t.group;
  const float* values = call.values + (group * panels_ + panel) * rows;
  const auto* packed = static_cast<const float*>(static_cast<const void*>(call.arrays.packed));
  const std::int64_t channel = t.image * g_.oc + t.group * g_.group_oc + panel * rows;
  const std::int64_t at = channel * g_.oplane() + t.first_row * columns_out_ + first;
  const bool last = k + depth == depth_;
  const bool to_y = writes_y();
  const float* residual = to_y && call.arrays.residual != nullptr ? call.arrays.residual + at : nullptr;
  const std::int32_t* offsets = offsets_.data() + (local_ ? 0 : k);
  routines_.multiply_words[static_cast<std::size_t>(precision_)](
      {packed + (group * panels_ * depth_ + panels_ * k + panel * depth) * rows, b,
       streaming_ ? offsets : nullptr, depth, std::min(rows, g_.group_oc - panel * rows), count,
       k == 0 ? values : nullptr, sums, last, values + rows_size(), values + 2 * rows_size(), residual,
       residual_last_, epilogue_.low(), epilogue_.high(), to_y ? call.arrays.y + at : sums,
       to_y ? g_.oplane() : routines_.columns});
  if (last && !to_y) write_rows(call, t, panel, first, count, sums);
}

/// What comes after the sums of a panel.
void Conv2dDirect::write_rows(const Call& call, const Task& t, std::int64_t panel, std::int64_t first,
                              std::int64_t count, float* sums) const {
  const std::int64_t first_row = panel * routines_.rows;
  const std::int64_t last_row = std::min(first_row + routines_.rows, g_.group_oc);
  const std::int64_t channels = gated_ ? g_.oc / 2 : g_.oc;
  const Conv2dArrays& arrays = call.arrays;
  for (std::int64_t row = first_row; row < last_row; row += gated_ ? 2 : 1) {
    float* from = sums + (row - first_row) * routines_.columns;
    const std::int64_t plane = (t.image * channels + filter_of_row(g_, gated_, t.group, row)) * g_.oplane();
    if (gated_) routines_.gate(from, from + routines_.columns, from, count);
    if (upsampled_) {
      write_upsampled(call, t, plane, first, count, from);
      continue;
    }
    const std::int64_t at = plane + t.first_row * columns_out_ + first;
    epilogue_.finish(from, arrays.residual != nullptr ? arrays.residual + at : nullptr, arrays.y + at, count);
  }
}

/// Sums of one parity of rows and columns.
void Conv2dDirect::write_upsampled(const Call& call, const Task& t, std::int64_t plane, std::int64_t first,
                                   std::int64_t count, float* sums) const {
  const Conv2dArrays& arrays = call.arrays;
  for (std::int64_t done = 0; done < count;) {
    const std::int64_t i = (first + done) / columns_out_;
    const std::int64_t j = (first + done) % columns_out_;
    const std::int64_t length = std::min(count - done, columns_out_ - j);
    float* from = sums + done;
    done += length;
    const std::int64_t at = plane + (2 * i + t.variant / 2) * g_.owidth + 2 * j + t.variant % 2;
    std::array<float, 64> residual;
    for (std::int64_t n = 0; arrays.residual != nullptr && n < length; ++n)
      residual[static_cast<std::size_t>(n)] = arrays.residual[at + 2 * n];
    epilogue_.finish(from, arrays.residual != nullptr ? residual.data() : nullptr, from, length);
    for (std::int64_t n = 0; n < length; ++n) arrays.y[at + 2 * n] = from[n];
  }
}

/// Few filters: the planes of a block of the depth are made, then multiplied where they lie.
void Conv2dDirect::run_streaming(const Call& call, const Task& t, float* memory) const {
  const std::int64_t columns = routines_.columns;
  const std::int64_t phases = g_.stride_y * g_.stride_x;
  const std::int64_t first_word = (t.image * g_.groups + t.group) * group_words_;
  const std::int64_t rows = std::min(strip_rows_, rows_out_ - t.first_row) + reach_y_;
  const std::int64_t words = local_ ? block_depth_ / taps_ : 0;
  for (std::int64_t k = 0; k < depth_; k += block_depth_) {
    for (std::int64_t word = 0; word < std::min(words, group_words_ - k / taps_); ++word)
      fill_plane(call, first_word + k / taps_ + word, t.first_row, rows,
                 memory + word * phases * plane_size_);
    const float* planes = local_ ? memory : call.arrays.x + first_word * g_.plane();
    float* sums = memory + strip_planes();
    for (std::int64_t first = t.first, count = 0; first < t.first + t.count; first += count) {
      const std::int64_t column = first % columns_out_;
      count = std::min({columns, columns_out_ - column, t.first + t.count - first});
      const float* b = planes + first / columns_out_ * plane_width_ + column;
      for (std::int64_t panel = t.first_panel; panel < t.last_panel;
           ++panel, sums += routines_.rows * columns)
        multiply(call, t, panel, k, first, count, b, sums);
    }
  }
}

/// The gathered words k, ... of positions that fill at most one panel of columns.
void Conv2dDirect::gather_panel(const Call& call, const Task& t, std::int64_t first, std::int64_t count,
                                std::int64_t k, const float* planes, float* b) const {
  std::array<WordRun, 64> runs;
  std::int64_t run_count = 0;
  const std::int64_t row_size = in_place_ ? g_.stride_y * in_width_ : plane_width_;
  const std::int64_t stride = in_place_ ? g_.stride_x : 1;
  for (std::int64_t done = 0; done < count;) {
    const std::int64_t column = (first + done) % columns_out_;
    const std::int64_t length = std::min(count - done, columns_out_ - column);
    runs[static_cast<std::size_t>(run_count++)] = {(first + done) / columns_out_ * row_size + column * stride,
                                                   done, length};
    done += length;
  }
  const std::int64_t depth = std::min(block_depth_, depth_ - k);
  const std::int32_t* offsets = offsets_.data() + t.variant * depth_ + k;
  const Quantiser& q = call.quantiser;
  if (!in_place_) {
    const WordGather words{{planes, 0, 0, 0, 1, 0}, offsets, runs.data(), run_count, 1};
    routines_.gather_copies(words, depth, b);
    return;
  }
  const float* x = call.arrays.x + (t.image * g_.ic + t.group * g_.group_ic) * g_.plane();
  const WordGather words{{x, g_.plane(), g_.group_ic - k * lanes_, q.zero, 1 / q.step, least_},
                         offsets,
                         runs.data(),
                         run_count,
                         stride};
  routines_.gather[static_cast<std::size_t>(precision_)](words, depth, b);
}

/// Many filters: a block of the depth is gathered for some positions, then multiplied by all of them.
void Conv2dDirect::run_gathered(const Call& call, const Task& t, float* memory) const {
  const std::int64_t columns = routines_.columns;
  const std::int64_t phases = g_.stride_y * g_.stride_x;
  const std::int64_t first_word = (t.image * g_.groups + t.group) * group_words_;
  const std::int64_t rows = std::min(strip_rows_, rows_out_ - t.first_row) + reach_y_;
  for (std::int64_t word = 0; local_ && word < group_words_; ++word)
    fill_plane(call, first_word + word, t.first_row, rows, memory + word * phases * plane_size_);
  const float* planes = local_ ? memory : call.planes + first_word * phases * plane_size_;
  float* const gathered = memory + strip_planes();
  float* const tile = gathered + block_depth_ * task_positions_ + kRowAlignment;
  const std::int64_t panel_size = routines_.rows * columns;
  for (std::int64_t start = t.first; start < t.first + t.count; start += task_positions_) {
    const std::int64_t count = std::min(task_positions_, t.first + t.count - start);
    for (std::int64_t k = 0; k < depth_; k += block_depth_) {
      for (std::int64_t column = 0; column < count; column += columns)
        gather_panel(call, t, start + column, std::min(columns, count - column), k, planes,
                     gathered + column * block_depth_);
      float* sums = tile;
      for (std::int64_t panel = t.first_panel; panel < t.last_panel; ++panel)
        for (std::int64_t column = 0; column < count; column += columns, sums += panel_size)
          multiply(call, t, panel, k, start + column, std::min(columns, count - column),
                   gathered + column * block_depth_, sums);
    }
  }
}

void Conv2dDirect::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
  if (task_count() == 0) return;
  auto* memory = static_cast<float*>(static_cast<void*>(scratch.data()));
  float* const values = memory;
  float* const planes = memory + 3 * rows_size();
  const Call call{arrays, quantiser(arrays), values, planes};
  make_row_values(call, values);
  const std::int64_t phases = g_.stride_y * g_.stride_x;
  if (shared_planes() > 0)
    parallel_for(g_.batch * g_.groups * group_words_, [&](std::int64_t word) {
      fill_plane(call, word, 0, rows_out_ + reach_y_, planes + word * phases * plane_size_);
    });
  float* const tasks = planes + shared_planes();
  const std::int64_t rest = static_cast<std::int64_t>(scratch.size() / sizeof(float)) - (tasks - memory);
  const std::int64_t slots = std::min<std::int64_t>(task_count(), rest / thread_size());
  std::atomic<std::int64_t> next{0};
  parallel_for(slots, [&](std::int64_t slot) {
    for (std::int64_t i = next++; i < task_count(); i = next++) {
      float* own = tasks + slot * thread_size();
      if (streaming_)
        run_streaming(call, task(i), own);
      else
        run_gathered(call, task(i), own);
    }
  });
}

}  // namespace slide::ops
