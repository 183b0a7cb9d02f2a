// A strip of lines is transformed, channel by channel; then tasks of some panels of tiles (about 48) and some
// panels of weights multiply all frequencies, one after the other, into memory of their own that stays in the
// second-level cache, and transform it back while it is there. Of a frequency, a task goes over its weights
// once, so that they stream (from the third-level cache) at a fraction of what that gives, and the tiles'
// panel stays near.

#include "ops/conv2d/conv2d_winograd.h"

#include <algorithm>
#include <atomic>
#include <cmath>

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
    if (routines->isa == isa) return *routines;
  return *all[std::size(all) - 1];
}

namespace {

constexpr std::int64_t kBlockDepth = 32;       // as in Conv2dGemm
constexpr std::int64_t kTaskTiles = 48;        // enough products for each weight that streams by
constexpr std::int64_t kTaskRows = 64;         // with kTaskTiles, 36 frequencies take 432 KiB
constexpr std::int64_t kFewTasks = 16;         // with fewer in a strip, tasks have fewer rows
constexpr std::int64_t kMinTaskRows = 16;      //
constexpr std::int64_t kStripBytes = 8 << 20;  // of transformed input, to be read from the caches
constexpr std::int64_t kMinStripTiles = 4 * kTaskTiles;
// Frequencies are read and written together; as powers of two apart they would share a set of the cache.
constexpr std::int64_t kSkew = 16;

std::int64_t divide_up(std::int64_t a, std::int64_t b) { return (a + b - 1) / b; }
std::int64_t round_up(std::int64_t a, std::int64_t b) { return divide_up(a, b) * b; }

/// How many of the numbers 0 .. extent - 1 are, divided by the dilation, multiples of the tile: where tiles
/// start.
std::int64_t tile_count(std::int64_t extent, std::int64_t tile, std::int64_t dilation) {
  const std::int64_t group = tile * dilation;
  return extent / group * dilation + std::min(dilation, extent % group);
}

/// The first row or column of tile `index`.
std::int64_t tile_start(std::int64_t index, std::int64_t tile, std::int64_t dilation) {
  return index / dilation * tile * dilation + index % dilation;
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

const WinogradTransforms& transforms_of(int tile, Isa isa) {
  const WinogradRoutines& routines = winograd_routines(isa);
  return tile == 2 ? routines.two : tile == 4 ? routines.four : routines.six;
}

/// Sizes of what an input transform needs, in floats.
struct InputMemory {
  std::int64_t zeros, row_size, phase_size;
  [[nodiscard]] std::int64_t total(std::int64_t tile) const {
    return zeros + (tile + 2) * row_size + tile * phase_size;
  }
};

InputMemory input_memory(const Conv2dGeometry& g, std::int64_t tile, std::int64_t line_tiles) {
  const std::int64_t groups = divide_up(line_tiles, g.dilation_x) + 1;
  return {round_up(g.width, kRowAlignment),
          round_up(groups, kRowAlignment) * tile * g.dilation_x + kRowAlignment,
          round_up(groups * g.dilation_x, kRowAlignment) + 2 * kRowAlignment};
}

}  // namespace

struct Conv2dWinogradBase::Strip {
  std::int64_t image;
  std::int64_t first_line, last_line;
  std::int64_t tiles;
  std::int64_t panels;
  std::int64_t panel_stride, frequency_stride;  // of V: [frequency][panel][channel][column]
};

struct Conv2dWinogradBase::Task {
  std::int64_t first_panel, last_panel;    // of tiles
  std::int64_t first_filter, last_filter;  // panels of weights
};

/// Adjacent tiles of one line and one panel.
struct Conv2dWinogradBase::Run {
  std::int64_t image;
  std::int64_t row;          // the first output row
  std::int64_t first, last;  // in the line
  std::int64_t row_size, sums_size;
};

Conv2dWinogradBase::Conv2dWinogradBase(int tile, const Conv2dRoutines& routines,
                                       const Conv2dGeometry& geometry, const Conv2dFusion& fusion)
    : routines_(routines),
      g_(geometry),
      gated_(fusion.gate),
      relu_input_(fusion.relu_input),
      epilogue_(fusion, routines.isa),
      matrices_(winograd_matrices(winograd_pairs(tile))),
      points_(points_of(tile)),
      transforms_(transforms_of(tile, routines.isa)),
      tile_(tile),
      frequencies_((tile + 2) * (tile + 2)),
      block_depth_(std::min(g_.ic, kBlockDepth)),
      lines_(tile_count(g_.oheight, tile, g_.dilation_y)),
      line_tiles_(tile_count(g_.owidth, tile, g_.dilation_x)),
      panels_(divide_up(g_.oc, routines.rows)),
      task_columns_(std::max<std::int64_t>(1, kTaskTiles / routines.columns)) {
  const std::int64_t strip_tiles = std::max(
      kStripBytes / (frequencies_ * g_.ic * static_cast<std::int64_t>(sizeof(float))), kMinStripTiles);
  const std::int64_t most = std::clamp<std::int64_t>(strip_tiles / line_tiles_, 1, lines_);
  strip_lines_ = divide_up(lines_, divide_up(lines_, most));
  strip_panels_ = divide_up(strip_lines_ * line_tiles_, routines.columns);
  const std::int64_t runs = divide_up(kFewTasks, divide_up(strip_panels_, task_columns_));
  const std::int64_t rows =
      std::clamp(divide_up(g_.oc, std::max(runs, divide_up(g_.oc, kTaskRows))), kMinTaskRows, kTaskRows);
  task_panels_ = std::min(divide_up(rows, routines.rows), panels_);
}

bool Conv2dWinogradBase::possible(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return g.kheight == 3 && g.kwidth == 3 && g.stride_y == 1 && g.stride_x == 1 && g.groups == 1 &&
         g.batch * g.oplane() > 0 && !fusion.upsample_input;
}

template <int Tile>
bool Conv2dWinograd<Tile>::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return possible(g, fusion) && g.ic >= 16 && g.oc >= 16;
}
template class Conv2dWinograd<2>;
template class Conv2dWinograd<4>;
template class Conv2dWinograd<6>;

double Conv2dWinogradBase::error_factor() const noexcept {
  const std::int64_t pairs = tile_ / 2;
  const std::int64_t fused = routines_.fused ? 1 : 0;
  const std::int64_t input = fused != 0 ? pairs : 2 * pairs;
  const std::int64_t product = block_depth_ + divide_up(g_.ic, block_depth_) + (1 - fused);
  const std::int64_t output = pairs + 1 + (1 - fused);
  return 1.001 * static_cast<double>(2 * input + 1 + product + 2 * output + 1);
}

double Conv2dWinogradBase::macs() const noexcept {
  return static_cast<double>(g_.batch * lines_ * line_tiles_ * frequencies_) *
         static_cast<double>(g_.ic * g_.oc);
}

std::size_t Conv2dWinogradBase::packed_bytes() const noexcept {
  return static_cast<std::size_t>(frequencies_ * panels_ * g_.ic * routines_.rows) * sizeof(float);
}

/// Gated: each feature is followed by its gate.
std::int64_t Conv2dWinogradBase::filter_of_row(std::int64_t row) const noexcept {
  return gated_ ? row / 2 + (row % 2 == 0 ? 0 : g_.oc / 2) : row;
}

/// U as [frequency][panel][channel][row], zeros below the last filter.
void Conv2dWinogradBase::pack(const float* weight, std::byte* packed) const {
  const std::int64_t rows = routines_.rows;
  auto* to = static_cast<float*>(static_cast<void*>(packed));
  parallel_for(panels_, [&](std::int64_t panel) {
    std::vector<double> u(static_cast<std::size_t>(frequencies_));
    for (std::int64_t c = 0; c < g_.ic; ++c)
      for (std::int64_t m = 0; m < rows; ++m) {
        const std::int64_t row = panel * rows + m;
        double taps[9] = {};
        if (row < g_.oc) std::copy_n(weight + (filter_of_row(row) * g_.ic + c) * 9, 9, taps);
        winograd_filter(matrices_, taps, u.data());
        for (std::int64_t f = 0; f < frequencies_; ++f)
          to[((f * panels_ + panel) * g_.ic + c) * rows + m] =
              static_cast<float>(u[static_cast<std::size_t>(f)]);
      }
  });
}

Conv2dWinogradBase::Strip Conv2dWinogradBase::strip(std::int64_t index) const noexcept {
  const std::int64_t strips = divide_up(lines_, strip_lines_);
  Strip s{};
  s.image = index / strips;
  s.first_line = index % strips * strip_lines_;
  s.last_line = std::min(s.first_line + strip_lines_, lines_);
  s.tiles = (s.last_line - s.first_line) * line_tiles_;
  s.panels = divide_up(s.tiles, routines_.columns);
  s.panel_stride = g_.ic * routines_.columns;
  s.frequency_stride = strip_panels_ * s.panel_stride + kSkew;
  return s;
}

std::int64_t Conv2dWinogradBase::input_size() const noexcept {
  return input_memory(g_, tile_, line_tiles_).total(tile_);
}

/// The products, [frequency][panel of tiles][row][column] and a vector more; the sums of a run of two
/// filters.
std::int64_t Conv2dWinogradBase::task_size() const noexcept {
  const std::int64_t products =
      frequencies_ * (task_columns_ * task_panels_ * routines_.rows * routines_.columns + kSkew);
  return products + 2 * kRowAlignment + 2 * tile_ * tile_ * round_up(routines_.columns, kRowAlignment);
}

std::int64_t Conv2dWinogradBase::tasks_of(std::int64_t tile_panels) const noexcept {
  return divide_up(tile_panels, task_columns_) * divide_up(panels_, task_panels_);
}

std::size_t Conv2dWinogradBase::scratch_bytes() const noexcept {
  const std::int64_t v =
      round_up(frequencies_ * (strip_panels_ * g_.ic * routines_.columns + kSkew), kRowAlignment);
  const std::int64_t threads =
      std::min<std::int64_t>(thread_count(), std::max(tasks_of(strip_panels_), g_.ic));
  const std::int64_t thread = round_up(std::max(input_size(), task_size()), kRowAlignment);
  return static_cast<std::size_t>(v + threads * thread) * sizeof(float);
}

void Conv2dWinogradBase::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
  const std::int64_t v_size =
      round_up(frequencies_ * (strip_panels_ * g_.ic * routines_.columns + kSkew), kRowAlignment);
  const std::int64_t thread = round_up(std::max(input_size(), task_size()), kRowAlignment);
  auto* v = static_cast<float*>(static_cast<void*>(scratch.data()));
  const std::int64_t slots = (static_cast<std::int64_t>(scratch.size() / sizeof(float)) - v_size) / thread;
  const std::int64_t strips = g_.batch * divide_up(lines_, strip_lines_);
  for (std::int64_t i = 0; i < strips; ++i) run_strip(strip(i), arrays, v, v + v_size, slots);
}

void Conv2dWinogradBase::run_strip(const Strip& strip, const Conv2dArrays& arrays, float* v, float* memory,
                                   std::int64_t slots) const {
  const std::int64_t thread = round_up(std::max(input_size(), task_size()), kRowAlignment);
  const float* x = arrays.x + strip.image * g_.ic * g_.plane();
  std::atomic<std::int64_t> next_channel{0};
  parallel_for(slots, [&](std::int64_t slot) {
    float* mine = memory + slot * thread;
    std::fill_n(mine, input_size(), 0.0F);
    for (std::int64_t c = next_channel++; c < g_.ic; c = next_channel++)
      transform_channel(strip, c, x + c * g_.plane(), v, mine);
  });
  const std::int64_t columns = divide_up(strip.panels, task_columns_);
  const std::int64_t tasks = tasks_of(strip.panels);
  std::atomic<std::int64_t> next_task{0};
  parallel_for(slots, [&](std::int64_t slot) {
    for (std::int64_t i = next_task++; i < tasks; i = next_task++) {
      const std::int64_t tiles = i % columns * task_columns_;
      const std::int64_t filters = i / columns * task_panels_;
      run_task(strip,
               {tiles, std::min(tiles + task_columns_, strip.panels), filters,
                std::min(filters + task_panels_, panels_)},
               arrays, v, memory + slot * thread);
    }
  });
}

/// `memory` is zero, but for what calls for other channels left in it.
void Conv2dWinogradBase::transform_channel(const Strip& strip, std::int64_t channel, const float* x, float* v,
                                           float* memory) const {
  const InputMemory sizes = input_memory(g_, tile_, line_tiles_);
  const std::int64_t used = (divide_up(line_tiles_, g_.dilation_x) * tile_ + 2) * g_.dilation_x;
  const float* rows[8];
  WinogradInput in{};
  in.rows = rows;
  in.left = std::min(g_.left, used);
  in.count = std::clamp<std::int64_t>(used - g_.left, 0, g_.width);
  in.relu = relu_input_;
  in.dilation = g_.dilation_x;
  in.tiles = line_tiles_;
  in.buffer = memory + sizes.zeros;
  in.row_size = sizes.row_size;
  in.phases = in.buffer + (tile_ + 2) * sizes.row_size;
  in.phase_size = sizes.phase_size;
  in.v = v + channel * routines_.columns;
  in.columns = routines_.columns;
  in.panel_stride = strip.panel_stride;
  in.frequency_stride = strip.frequency_stride;
  for (std::int64_t line = strip.first_line; line < strip.last_line; ++line) {
    const std::int64_t top = tile_start(line, tile_, g_.dilation_y) - g_.top;
    for (std::int64_t u = 0; u < tile_ + 2; ++u) {
      const std::int64_t row = top + u * g_.dilation_y;
      rows[u] = row >= 0 && row < g_.height ? x + row * g_.width : memory;
    }
    in.first = (line - strip.first_line) * line_tiles_;
    transforms_.input(points_, in);
  }
}

void Conv2dWinogradBase::run_task(const Strip& strip, const Task& task, const Conv2dArrays& arrays,
                                  const float* v, float* memory) const {
  const std::int64_t rows = routines_.rows, columns = routines_.columns;
  const auto* u = static_cast<const float*>(static_cast<const void*>(arrays.packed));
  const std::int64_t block = (task.last_filter - task.first_filter) * rows * columns;  // of a tile panel
  const std::int64_t stride = task_columns_ * task_panels_ * rows * columns + kSkew;   // of a frequency
  for (std::int64_t f = 0; f < frequencies_; ++f) {
    std::fill_n(memory + f * stride, (task.last_panel - task.first_panel) * block, 0.0F);
    for (std::int64_t filter = task.first_filter; filter < task.last_filter; ++filter)
      for (std::int64_t panel = task.first_panel; panel < task.last_panel; ++panel)
        for (std::int64_t c = 0; c < g_.ic; c += block_depth_)
          routines_.multiply(u + ((f * panels_ + filter) * g_.ic + c) * rows,
                             v + f * strip.frequency_stride + panel * strip.panel_stride + c * columns,
                             std::min(block_depth_, g_.ic - c),
                             memory + f * stride + (panel - task.first_panel) * block +
                                 (filter - task.first_filter) * rows * columns,
                             std::min(rows, g_.oc - filter * rows),
                             std::min(columns, strip.tiles - panel * columns));
  }
  float* sums = memory + frequencies_ * stride + kRowAlignment;
  const std::int64_t sums_size = tile_ * tile_ * round_up(columns, kRowAlignment);
  const std::int64_t last_row = std::min(task.last_filter * rows, g_.oc);
  for (std::int64_t panel = task.first_panel; panel < task.last_panel; ++panel) {
    const std::int64_t end = std::min((panel + 1) * columns, strip.tiles);
    for (std::int64_t first = panel * columns; first < end;) {
      const std::int64_t line = first / line_tiles_;
      const std::int64_t last = std::min((line + 1) * line_tiles_, end);
      const Run run{strip.image,
                    tile_start(strip.first_line + line, tile_, g_.dilation_y),
                    first - line * line_tiles_,
                    last - line * line_tiles_,
                    sums_size / tile_,
                    sums_size};
      for (std::int64_t row = task.first_filter * rows; row < last_row; ++row) {
        float* target = sums + (gated_ ? row % 2 * sums_size : 0);
        transforms_.output(
            points_, {memory + (panel - task.first_panel) * block +
                          (row - task.first_filter * rows) * columns + first % columns,
                      stride, last - first, arrays.bias != nullptr ? arrays.bias[filter_of_row(row)] : 0.0F,
                      g_.dilation_x == 1, target, run.row_size});
        if (!gated_ || row % 2 == 1) write_row(run, row, sums, arrays);
      }
      first = last;
    }
  }
}

/// The end of a filter's sums, or of a feature's and its gate's, and where they belong. Dilated, a tile's
/// columns are written in pieces of the phases that the run has.
void Conv2dWinogradBase::write_row(const Run& run, std::int64_t row, float* sums,
                                   const Conv2dArrays& arrays) const {
  const std::int64_t channels = gated_ ? g_.oc / 2 : g_.oc;
  const std::int64_t channel = gated_ ? row / 2 : row;
  const std::int64_t plane = (run.image * channels + channel) * g_.oplane();
  const auto finish = [&](float* from, std::int64_t orow, std::int64_t column, std::int64_t count) {
    count = std::min(count, g_.owidth - column);
    if (count <= 0) return;
    if (gated_) routines_.gate(from, from + run.sums_size, from, count);
    const std::int64_t at = plane + orow * g_.owidth + column;
    epilogue_.finish(from, arrays.residual != nullptr ? arrays.residual + at : nullptr, arrays.y + at, count);
  };
  const std::int64_t d = g_.dilation_x;
  for (std::int64_t i = 0; i < tile_; ++i) {
    const std::int64_t orow = run.row + i * g_.dilation_y;
    if (orow >= g_.oheight) return;
    float* from = sums + i * run.row_size;
    if (d == 1) {
      finish(from, orow, run.first * tile_, (run.last - run.first) * tile_);
      continue;
    }
    for (std::int64_t t = run.first; t < run.last;) {
      const std::int64_t count = std::min(d - t % d, run.last - t);
      for (std::int64_t j = 0; j < tile_; ++j)
        finish(from + j * (run.row_size / tile_) + t - run.first, orow, tile_start(t, tile_, d) + j * d,
               count);
      t += count;
    }
  }
}

namespace {

std::vector<std::vector<double>> magnitudes(std::vector<std::vector<double>> a) {
  for (auto& row : a)
    for (double& value : row) value = std::fabs(value);
  return a;
}

/// A X Aᵀ of n×n numbers x, for A of any number of rows.
std::vector<double> sandwich(const std::vector<std::vector<double>>& a, const std::vector<double>& x) {
  const std::size_t n = a[0].size(), m = a.size();
  std::vector<double> half(m * n), y(m * m);
  for (std::size_t i = 0; i < m; ++i)
    for (std::size_t k = 0; k < n; ++k)
      for (std::size_t j = 0; j < n; ++j) half[i * n + j] += a[i][k] * x[k * n + j];
  for (std::size_t i = 0; i < m; ++i)
    for (std::size_t k = 0; k < n; ++k)
      for (std::size_t j = 0; j < m; ++j) y[i * m + j] += half[i * n + k] * a[j][k];
  return y;
}

// u times it is 2^-126: each operand, product and sum may be flushed to zero below that, with some room for
// the steps of a transform.
constexpr double kUnderflow = 0x1p-98;

}  // namespace

void Conv2dWinogradBase::error_scale(int tile, const Conv2dGeometry& g, std::span<const Tensor> inputs,
                                     std::span<double> scale) {
  WinogradMatrices w = winograd_matrices(winograd_pairs(tile));
  w = {w.tile, w.frequencies, magnitudes(w.at), magnitudes(w.g), magnitudes(w.bt)};
  const auto n = static_cast<std::size_t>(w.frequencies);
  const std::size_t count = n * n;
  const std::span<const double> x = inputs[0].data<double>(), weight = inputs[1].data<double>();
  const auto filters = static_cast<std::size_t>(g.oc), channels = static_cast<std::size_t>(g.ic);
  std::vector<double> u(filters * channels * count);
  for (std::size_t i = 0; i < filters * channels; ++i) {
    double taps[9];
    for (std::size_t k = 0; k < 9; ++k) taps[k] = std::fabs(weight[i * 9 + k]);
    winograd_filter(w, taps, u.data() + i * count);
    for (std::size_t f = 0; f < count; ++f) u[i * count + f] += kUnderflow;
  }
  const std::int64_t lines = tile_count(g.oheight, tile, g.dilation_y);
  const std::int64_t line_tiles = tile_count(g.owidth, tile, g.dilation_x);
  parallel_for(g.batch * lines * line_tiles, [&](std::int64_t index) {
    const std::int64_t image = index / line_tiles / lines;
    const std::int64_t row = tile_start(index / line_tiles % lines, tile, g.dilation_y);
    const std::int64_t column = tile_start(index % line_tiles, tile, g.dilation_x);
    std::vector<double> v(channels * count), d(count);
    for (std::int64_t c = 0; c < g.ic; ++c) {
      for (std::int64_t i = 0; i < w.frequencies; ++i)
        for (std::int64_t j = 0; j < w.frequencies; ++j) {
          const std::int64_t y_at = row + i * g.dilation_y - g.top, x_at = column + j * g.dilation_x - g.left;
          const bool inside = y_at >= 0 && y_at < g.height && x_at >= 0 && x_at < g.width;
          d[static_cast<std::size_t>(i * w.frequencies + j)] =
              inside
                  ? std::fabs(
                        x[static_cast<std::size_t>(((image * g.ic + c) * g.height + y_at) * g.width + x_at)])
                  : 0;
        }
      const std::vector<double> transformed = sandwich(w.bt, d);
      for (std::size_t f = 0; f < count; ++f)
        v[static_cast<std::size_t>(c) * count + f] = transformed[f] + kUnderflow;
    }
    for (std::int64_t o = 0; o < g.oc; ++o) {
      std::vector<double> m(count, kUnderflow);
      for (std::size_t i = 0; i < channels * count; ++i)
        m[i % count] += u[static_cast<std::size_t>(o) * channels * count + i] * v[i];
      const std::vector<double> y = sandwich(w.at, m);
      const double bias = g.has_bias ? std::fabs(inputs[2].data<double>()[static_cast<std::size_t>(o)]) : 0;
      for (std::int64_t i = 0; i < tile; ++i)
        for (std::int64_t j = 0; j < tile; ++j) {
          const std::int64_t orow = row + i * g.dilation_y, ocolumn = column + j * g.dilation_x;
          if (orow >= g.oheight || ocolumn >= g.owidth) continue;
          scale[static_cast<std::size_t>(((image * g.oc + o) * g.oheight + orow) * g.owidth + ocolumn)] =
              y[static_cast<std::size_t>(i * tile + j)] + bias + kUnderflow;
        }
    }
  });
}

}  // namespace slide::ops
