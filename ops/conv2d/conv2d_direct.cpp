#include "ops/conv2d/conv2d_direct.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "ops/conv2d/conv2d_op.h"
#include "ops/conv2d/conv2d_winograd.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kMinBlockDepth = 160;
constexpr std::int64_t kInt8BlockDepth =
    160;                                  // words of all positions of a tile: most of the first-level cache
constexpr std::int64_t kTileColumns = 2;  // panels of positions in a task: the weights are read once for them
constexpr std::int64_t kFewTasks = 16;    // with fewer, output channels are split, too
constexpr std::int64_t kMinTaskPanels = 4;
constexpr double kUsefulPositions = 0.85;

std::int64_t divide_up(std::int64_t a, std::int64_t b) { return (a + b - 1) / b; }
std::int64_t aligned(std::int64_t count) { return divide_up(count, kRowAlignment) * kRowAlignment; }

/// Blocks of about the root of the depth make the fewest roundings; all are equally deep.
std::int64_t block_depth_for(std::int64_t depth, Precision precision) {
  const auto root = static_cast<std::int64_t>(std::sqrt(static_cast<double>(depth)));
  const std::int64_t most = precision == Precision::kInt8 ? kInt8BlockDepth : std::max(kMinBlockDepth, root);
  return divide_up(depth, divide_up(depth, most));
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

/// The nearest bfloat16, ties to even; NaN stays NaN.
std::uint32_t bf16_bits(float x) {
  const auto bits = std::bit_cast<std::uint32_t>(x);
  if (x != x) return bits >> 16U | 0x40U;
  return (bits + 0x7FFFU + (bits >> 16U & 1U)) >> 16U;
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

/// Taps 2×2 of one parity stand for these rows (or columns) of the 3×3.
bool stands_for(std::int64_t parity, std::int64_t tap, std::int64_t u) {
  return parity == 0 ? (tap == 0) == (u == 0) : (tap == 1) == (u == 2);
}

}  // namespace

struct Conv2dDirect::Task {
  std::int64_t image, group;
  int variant;
  std::int64_t first_panel, last_panel;  // of weights
  std::int64_t first, count;             // positions
};

bool Conv2dDirect::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  if (!possible(g, fusion)) return false;
  if (fusion.upsample_input || reads_once(g)) return true;
  const std::int64_t width = g.owidth + (g.kwidth - 1) * g.dilation_x / g.stride_x;
  return static_cast<double>(g.owidth) >= kUsefulPositions * static_cast<double>(width);
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
      in_place_(precision == Precision::kFp32 && !upsampled_ && !relu_input_ && reads_once(g_)),
      epilogue_(fusion, routines.isa, true),
      residual_(fusion.residual),
      in_height_(upsampled_ ? g_.height / 2 : g_.height),
      in_width_(upsampled_ ? g_.width / 2 : g_.width),
      rows_out_(upsampled_ ? in_height_ : g_.oheight),
      columns_out_(upsampled_ ? in_width_ : g_.owidth),
      taps_(upsampled_ ? 4 : g_.kheight * g_.kwidth),
      lanes_(lanes_of(precision)),
      group_words_(divide_up(g_.group_ic, lanes_)),
      depth_(group_words_ * taps_),
      block_depth_(block_depth_for(depth_, precision)),
      panels_(divide_up(g_.group_oc, routines.rows)),
      task_panels_(panels_),
      row_tasks_(1),
      variants_(upsampled_ ? 4 : 1) {
  const std::int64_t reach_y = upsampled_ ? 2 : (g_.kheight - 1) * g_.dilation_y / g_.stride_y;
  const std::int64_t reach_x = upsampled_ ? 2 : (g_.kwidth - 1) * g_.dilation_x / g_.stride_x;
  plane_width_ = columns_out_ + reach_x;
  plane_size_ = (rows_out_ + reach_y) * plane_width_;
  const std::int64_t positions = (rows_out_ - 1) * plane_width_ + columns_out_;
  task_columns_ = std::min(kTileColumns, divide_up(positions, routines.columns)) * routines.columns;
  tiles_ = divide_up(positions, task_columns_);
  const std::int64_t tasks = g_.batch * g_.groups * variants_ * tiles_;
  if (tasks > 0 && tasks < kFewTasks) {
    task_panels_ = std::clamp(panels_ * tasks / kFewTasks, std::min(kMinTaskPanels, panels_), panels_);
    row_tasks_ = divide_up(panels_, task_panels_);
  }
  const std::int64_t phases = g_.stride_y * g_.stride_x;
  for (int variant = 0; variant < variants_; ++variant)
    for (std::int64_t k = 0; k < depth_; ++k) {
      const std::int64_t tap = k % taps_;
      const std::int64_t y = upsampled_ ? variant / 2 + tap / 2 : tap / g_.kwidth * g_.dilation_y;
      const std::int64_t x = upsampled_ ? variant % 2 + tap % 2 : tap % g_.kwidth * g_.dilation_x;
      const std::int64_t plane = k / taps_ * phases + y % g_.stride_y * g_.stride_x + x % g_.stride_x;
      offsets_.push_back(
          static_cast<std::int32_t>(plane * plane_size_ + y / g_.stride_y * plane_width_ + x / g_.stride_x));
    }
  offsets_.insert(offsets_.end(), kWordsAhead, offsets_.back());
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

/// Packed: the panels of all groups and variants; for integers then the step and the sum of each row.
std::size_t Conv2dDirect::packed_bytes() const noexcept {
  const std::int64_t rows = variants_ * g_.groups * panels_ * routines_.rows;
  return static_cast<std::size_t>(rows * (depth_ + (precision_ == Precision::kInt8 ? 2 : 0))) * sizeof(float);
}

double Conv2dDirect::weight_at(const float* weight, std::int64_t filter, std::int64_t channel, int variant,
                               std::int64_t tap) const noexcept {
  const float* kernel = weight + (filter * g_.group_ic + channel) * g_.kheight * g_.kwidth;
  if (!upsampled_) return static_cast<double>(kernel[tap]);
  double sum = 0;
  for (std::int64_t u = 0; u < 3; ++u)
    for (std::int64_t v = 0; v < 3; ++v)
      if (stands_for(variant / 2, tap / 2, u) && stands_for(variant % 2, tap % 2, v))
        sum += static_cast<double>(kernel[u * 3 + v]);
  return sum;
}

float Conv2dDirect::pack_word(const float* weight, std::int64_t filter, std::int64_t k, int variant,
                              float step) const {
  const std::int64_t channel = k / taps_ * lanes_;
  if (precision_ == Precision::kFp32)
    return static_cast<float>(weight_at(weight, filter, channel, variant, k % taps_));
  std::uint32_t word = 0;
  const int bits = precision_ == Precision::kBf16 ? 16 : 8;
  for (std::int64_t lane = 0; lane < std::min(lanes_, g_.group_ic - channel); ++lane) {
    const double w = weight_at(weight, filter, channel + lane, variant, k % taps_);
    const std::uint32_t part = bits == 16 ? bf16_bits(static_cast<float>(w))
                                          : static_cast<std::uint8_t>(std::lround(
                                                std::clamp(w / static_cast<double>(step), -127.0, 127.0)));
    word |= part << static_cast<unsigned>(lane * bits);
  }
  return std::bit_cast<float>(word);
}

void Conv2dDirect::pack(const float* weight, std::byte* packed) const {
  const std::int64_t rows = routines_.rows;
  const std::int64_t all_panels = variants_ * g_.groups * panels_;
  auto* panels = static_cast<float*>(static_cast<void*>(packed));
  float* steps = panels + all_panels * rows * depth_;
  float* sums = steps + all_panels * rows;
  parallel_for(all_panels, [&](std::int64_t panel) {
    const int variant = static_cast<int>(panel / (g_.groups * panels_));
    for (std::int64_t m = 0; m < rows; ++m) {
      const std::int64_t row = panel % panels_ * rows + m;
      const bool inside = row < g_.group_oc;
      const std::int64_t filter = inside ? filter_of_row(g_, gated_, panel / panels_ % g_.groups, row) : 0;
      float step = 1;
      if (precision_ == Precision::kInt8) {
        double largest = 0;
        for (std::int64_t k = 0; inside && k < g_.group_ic * taps_; ++k)
          largest = std::max(largest, std::fabs(weight_at(weight, filter, k / taps_, variant, k % taps_)));
        if (largest > 0) step = static_cast<float>(largest / 127);
        steps[panel * rows + m] = step;
      }
      float* to = panels + panel * depth_ * rows + m;
      if (precision_ == Precision::kFp32 && !upsampled_) {  // as it is: what most load time is spent on
        for (std::int64_t k = 0; k < depth_; ++k) to[k * rows] = inside ? weight[filter * depth_ + k] : 0.0F;
        continue;
      }
      std::int32_t sum = 0;
      for (std::int64_t k = 0; k < depth_; ++k) {
        const float word = inside ? pack_word(weight, filter, k, variant, step) : 0.0F;
        std::memcpy(to + k * rows, &word, sizeof word);
        for (unsigned lane = 0; lane < 4; ++lane)
          sum += static_cast<std::int8_t>(std::bit_cast<std::uint32_t>(word) >> 8 * lane & 0xFFU);
      }
      if (precision_ == Precision::kInt8) sums[panel * rows + m] = std::bit_cast<float>(sum);
    }
  });
}

std::int64_t Conv2dDirect::task_count() const noexcept {
  return g_.batch * g_.groups * variants_ * tiles_ * row_tasks_;
}

/// Of the planes and what is read behind their end.
std::int64_t Conv2dDirect::planes_size() const noexcept {
  if (in_place_) return 0;
  return g_.batch * g_.groups * group_words_ * g_.stride_y * g_.stride_x * plane_size_ + task_columns_;
}

std::size_t Conv2dDirect::scratch_bytes() const noexcept {
  const std::int64_t planes = planes_size();
  const std::int64_t threads = std::min<std::int64_t>(thread_count(), task_count());
  const std::int64_t thread = task_panels_ * routines_.rows * task_columns_;
  return static_cast<std::size_t>(aligned(planes) + threads * thread) * sizeof(float);
}

Conv2dDirect::Quantiser Conv2dDirect::quantiser(const Conv2dArrays& arrays) const {
  if (precision_ != Precision::kInt8) return {};
  float low = 0;
  float high = 0;
  if (arrays.range) {
    low = std::min(0.0F, arrays.range->low);
    high = std::max(0.0F, arrays.range->high);
  } else {
    const std::int64_t planes = g_.batch * g_.ic;
    std::vector<Range> ranges(static_cast<std::size_t>(planes));
    const std::int64_t size = in_height_ * in_width_;
    parallel_for(planes, [&](std::int64_t p) {
      Range& r = ranges[static_cast<std::size_t>(p)];
      routines_.range(arrays.x + p * size, size, &r.low, &r.high);
    });
    for (const Range& r : ranges) {
      low = std::min(low, r.low);
      high = std::max(high, r.high);
    }
  }
  if (relu_input_) low = 0;
  Quantiser q;
  q.step = (high - low) / 255;
  if (!(q.step > 0)) q.step = 1;
  q.zero = std::round(-low / q.step);
  return q;
}

/// The phases of one word of channels: index = (image, group, word).
void Conv2dDirect::fill_plane(std::int64_t index, const Conv2dArrays& arrays, const Quantiser& q,
                              float* planes) const {
  const std::int64_t word = index % group_words_;
  const std::int64_t group = index / group_words_ % g_.groups;
  const std::int64_t image = index / group_words_ / g_.groups;
  const std::int64_t phases = g_.stride_y * g_.stride_x;
  float* first = planes + index * phases * plane_size_;
  const auto zero = static_cast<std::uint32_t>(q.zero);
  const float outside = precision_ == Precision::kInt8 ? std::bit_cast<float>(zero * 0x01010101U) : 0.0F;
  const std::int64_t rows = plane_size_ / plane_width_;
  const std::int64_t channels = std::min(lanes_, g_.group_ic - word * lanes_);
  const std::int64_t channel = image * g_.ic + group * g_.group_ic + word * lanes_;
  for (std::int64_t row = 0; row < rows * g_.stride_y; ++row) {
    const std::int64_t i = row - g_.top;
    float* target = first + row % g_.stride_y * g_.stride_x * plane_size_ + row / g_.stride_y * plane_width_;
    WordRow source{{}, q.zero, 1 / q.step, relu_input_};
    for (std::int64_t c = 0; c < channels; ++c)
      source.x[c] = arrays.x + ((channel + c) * in_height_ + i) * in_width_;
    const bool inside = i >= 0 && i < in_height_;
    for (std::int64_t phase = 0; phase < g_.stride_x; ++phase, target += plane_size_)
      routines_.fill_row[static_cast<std::size_t>(precision_)](
          source, inside ? in_width_ : 0, phase - g_.left, g_.stride_x, outside, target, plane_width_);
  }
}

Conv2dDirect::Task Conv2dDirect::task(std::int64_t index) const noexcept {
  Task t{};
  const std::int64_t run = index % row_tasks_;
  index /= row_tasks_;
  t.first_panel = run * task_panels_;
  t.last_panel = std::min(t.first_panel + task_panels_, panels_);
  t.first = index % tiles_ * task_columns_;
  const std::int64_t positions = (rows_out_ - 1) * plane_width_ + columns_out_;
  t.count = std::min(task_columns_, positions - t.first);
  index /= tiles_;
  t.variant = static_cast<int>(index % variants_);
  index /= variants_;
  t.group = index % g_.groups;
  t.image = index / g_.groups;
  return t;
}

/// Whether positions follow each other in y as they do in the planes and nothing is left to do after the
/// sums: then the products are written straight to y.
bool Conv2dDirect::writes_y() const noexcept {
  return plane_width_ == columns_out_ && !gated_ && !upsampled_ && !residual_ && epilogue_.empty(nullptr);
}

/// Words k, ..., of a panel of weights times all positions of the task.
void Conv2dDirect::run_panel(const Task& t, const Conv2dArrays& arrays, const Quantiser& q,
                             std::int64_t panel, std::int64_t k, const float* b, float* tile) const {
  const std::int64_t rows = routines_.rows;
  const std::int64_t columns = routines_.columns;
  const std::int64_t first_row =
      ((t.variant * g_.groups + t.group) * panels_ + panel) * rows;  // of all packed
  const auto* packed = static_cast<const float*>(static_cast<const void*>(arrays.packed));
  const float* steps = packed + variants_ * g_.groups * panels_ * rows * depth_;
  const float* sums = steps + variants_ * g_.groups * panels_ * rows;
  std::array<float, 16> start{};
  std::array<float, 16> step{};
  std::array<float, 16> bias{};
  const std::int64_t row_count = std::min(rows, g_.group_oc - panel * rows);
  for (std::int64_t m = 0; m < row_count; ++m) {
    const auto at = static_cast<std::size_t>(m);
    if (arrays.bias != nullptr) bias[at] = arrays.bias[filter_of_row(g_, gated_, t.group, panel * rows + m)];
    start[at] = bias[at];
    if (precision_ != Precision::kInt8) continue;
    // What the zero point adds to each sum is taken off.
    start[at] = std::bit_cast<float>(-static_cast<std::int32_t>(q.zero) *
                                     std::bit_cast<std::int32_t>(sums[first_row + m]));
    step[at] = steps[first_row + m] * q.step;
  }
  const std::int64_t depth = std::min(block_depth_, depth_ - k);
  for (std::int64_t column = 0; column < t.count; column += columns) {
    float* part = tile + (column * (t.last_panel - t.first_panel) + (panel - t.first_panel) * columns) * rows;
    const std::int64_t channel = t.image * g_.oc + t.group * g_.group_oc + panel * rows;
    float* y = writes_y() ? arrays.y + channel * g_.oplane() + t.first + column : part;
    routines_.multiply_words[static_cast<std::size_t>(precision_)](
        {packed + first_row * depth_ + k * rows, b + column, offsets_.data() + t.variant * depth_ + k, depth,
         row_count, std::min(columns, t.count - column), in_place_, k == 0 ? start.data() : nullptr, part,
         k + depth == depth_, step.data(), bias.data(), epilogue_.low(), epilogue_.high(), y,
         writes_y() ? g_.oplane() : columns});
  }
}

void Conv2dDirect::run_task(const Task& t, const Conv2dArrays& arrays, const Quantiser& q,
                            const float* planes, float* tile) const {
  const std::int64_t phases = g_.stride_y * g_.stride_x;
  const float* b = planes + (t.image * g_.groups + t.group) * group_words_ * phases * plane_size_ + t.first;
  for (std::int64_t k = 0; k < depth_; k += block_depth_)
    for (std::int64_t panel = t.first_panel; panel < t.last_panel; ++panel)
      run_panel(t, arrays, q, panel, k, b, tile);
  if (!writes_y()) write_tile(t, arrays, tile);
}

void Conv2dDirect::write_tile(const Task& t, const Conv2dArrays& arrays, float* tile) const {
  const std::int64_t rows = routines_.rows;
  const std::int64_t columns = routines_.columns;
  const std::int64_t first_row = t.first_panel * rows;
  const std::int64_t last_row = std::min(t.last_panel * rows, g_.group_oc);
  for (std::int64_t column = 0; column < t.count; column += columns) {
    const std::int64_t count = std::min(columns, t.count - column);
    float* panel = tile + column * (t.last_panel - t.first_panel) * rows;
    for (std::int64_t row = first_row; row < last_row; row += gated_ ? 2 : 1) {
      float* sums = panel + (row - first_row) * columns;
      if (gated_) routines_.gate(sums, sums + columns, sums, count);
      write_row(t, arrays, filter_of_row(g_, gated_, t.group, row), sums, t.first + column, count);
    }
  }
}

/// Sums of the positions first, ..., first + count - 1 of one channel; those in the padding are dropped.
void Conv2dDirect::write_row(const Task& t, const Conv2dArrays& arrays, std::int64_t channel, float* sums,
                             std::int64_t first, std::int64_t count) const {
  const std::int64_t channels = gated_ ? g_.oc / 2 : g_.oc;
  const std::int64_t plane = (t.image * channels + channel) * g_.oplane();
  for (std::int64_t done = 0; done < count;) {
    const std::int64_t i = (first + done) / plane_width_;
    const std::int64_t j = (first + done) % plane_width_;
    const std::int64_t run = std::min(count - done, plane_width_ - j);
    const std::int64_t length = std::min(run, columns_out_ - j);
    float* from = sums + done;
    done += run;
    if (length <= 0) continue;
    if (!upsampled_) {
      const std::int64_t at = plane + i * g_.owidth + j;
      epilogue_.finish(from, arrays.residual != nullptr ? arrays.residual + at : nullptr, arrays.y + at,
                       length);
      continue;
    }
    const std::int64_t at = plane + (2 * i + t.variant / 2) * g_.owidth + 2 * j + t.variant % 2;
    std::array<float, 64> residual;
    for (std::int64_t n = 0; arrays.residual != nullptr && n < length; ++n)
      residual[static_cast<std::size_t>(n)] = arrays.residual[at + 2 * n];
    epilogue_.finish(from, arrays.residual != nullptr ? residual.data() : nullptr, from, length);
    for (std::int64_t n = 0; n < length; ++n) arrays.y[at + 2 * n] = from[n];
  }
}

void Conv2dDirect::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
  if (task_count() == 0) return;
  auto* memory = static_cast<float*>(static_cast<void*>(scratch.data()));
  const float* planes = arrays.x;
  const Quantiser q = quantiser(arrays);
  if (!in_place_) {
    std::fill_n(memory + planes_size() - task_columns_, task_columns_, 0.0F);
    parallel_for(g_.batch * g_.groups * group_words_,
                 [&](std::int64_t word) { fill_plane(word, arrays, q, memory); });
    planes = memory;
    memory += aligned(planes_size());
  }
  const std::int64_t thread_size = task_panels_ * routines_.rows * task_columns_;
  const auto rest = static_cast<std::int64_t>(scratch.size() / sizeof(float)) - aligned(planes_size());
  const std::int64_t slots = std::min<std::int64_t>(task_count(), rest / thread_size);
  std::atomic<std::int64_t> next{0};
  parallel_for(slots, [&](std::int64_t slot) {
    for (std::int64_t i = next++; i < task_count(); i = next++)
      run_task(task(i), arrays, q, planes, memory + slot * thread_size);
  });
}

void Conv2dDirectInt8::error_scale(const Conv2dGeometry& g, std::span<const Tensor> inputs,
                                   std::span<double> scale) {
  std::vector<Tensor> wide;
  for (const Tensor& t : inputs) {
    wide.push_back(t.clone());
    for (double& v : wide.back().mutable_data<double>()) v = std::fabs(v);
  }
  std::vector<double> products(scale.size());
  conv2d_reference(g, wide, products);
  double low = 0;
  double high = 0;
  for (const double v : inputs[0].data<double>()) {
    low = std::min(low, v);
    high = std::max(high, v);
  }
  for (double& v : wide[0].mutable_data<double>()) v += 1.001 * (high - low) / 255 / 2;
  const std::span<double> w = wide[1].mutable_data<double>();
  const auto depth = static_cast<std::size_t>(g.depth());
  for (std::size_t o = 0; o < w.size(); o += depth) {
    const double largest = *std::max_element(w.begin() + static_cast<std::ptrdiff_t>(o),
                                             w.begin() + static_cast<std::ptrdiff_t>(o + depth));
    for (std::size_t k = o; k < o + depth; ++k) w[k] += 1.001 * largest / 127 / 2;
  }
  conv2d_reference(g, wide, scale);
  for (std::size_t i = 0; i < scale.size(); ++i) scale[i] += 0x1p-22 * scale[i] - products[i] + 0x1p-100;
}

}  // namespace slide::ops
