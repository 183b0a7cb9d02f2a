#include "ops/attention/attention_strips.h"

#include <algorithm>
#include <cmath>

#include "runtime/threads.h"

namespace slide::ops {
namespace {

Conv2dGeometry unit_convolution() {
  Conv2dGeometry c{};
  c.batch = c.groups = 1;
  c.stride_y = c.stride_x = c.dilation_y = c.dilation_x = 1;
  return c;
}

/// Filters: the patches around `filters` foreground positions. Result: filters × positions.
Conv2dGeometry score_convolution(const AttentionGeometry& g, std::int64_t filters) {
  Conv2dGeometry c = unit_convolution();
  c.ic = c.group_ic = g.channels;
  c.oc = c.group_oc = filters;
  c.height = c.oheight = g.rows;
  c.width = c.owidth = g.columns;
  c.kheight = c.kwidth = g.patch;
  c.top = c.left = g.patch / 2;
  return c;
}

/// Filters: the weights of a strip's positions. Result: channels × positions of the strip × large patch.
Conv2dGeometry mixture_convolution(const AttentionGeometry& g) {
  Conv2dGeometry c = unit_convolution();
  c.batch = g.channels;
  c.ic = c.group_ic = 1;
  c.oc = c.group_oc = g.columns;
  c.height = g.height;
  c.width = g.width;
  c.kheight = g.rows;
  c.kwidth = g.columns;
  c.dilation_y = c.dilation_x = g.rate;
  c.oheight = c.owidth = 2 * g.rate;
  c.top = c.left = g.rate / 2;
  return c;
}

std::int64_t aligned(std::int64_t count) {
  return (count + kRowAlignment - 1) / kRowAlignment * kRowAlignment;
}

/// Of a convolution whose weights are new at each call.
std::size_t packed_bytes(const Conv2dGemm& method) {
  return (method.packed_bytes() + Tensor::kAlignment - 1) / Tensor::kAlignment * Tensor::kAlignment;
}
std::size_t convolution_bytes(const Conv2dGemm& method) {
  return packed_bytes(method) + method.scratch_bytes();
}

/// A step along column-major order: position (row, column) moved by `step` is (row, column + columns_moved).
struct ColumnStep {
  std::int64_t row;
  std::int64_t columns_moved;
};
ColumnStep column_step(std::int64_t row, std::int64_t step, std::int64_t rows) {
  std::int64_t to = row + step;
  std::int64_t moved = 0;
  for (; to < 0; to += rows) --moved;
  for (; to >= rows; to -= rows) ++moved;
  return {to, moved};
}

}  // namespace

struct AttentionStrips::Memory {
  float* foreground;          // reduced: channels × n
  float* background;          // the same
  float* inverse_norm;        // n
  float* usable;              // n: 1 or 0
  float* fuse;                // fuse × fuse
  float* patches;             // extended × channels·patch²
  float* scores;              // extended × n
  float* slots;               // fuse strips, columns × n
  float* weights;             // columns × n
  float* mixture;             // channels × columns × (2·rate)²
  std::span<std::byte> rest;  // for the convolutions
};

AttentionStrips::AttentionStrips(const AttentionRoutines& routines, const Conv2dRoutines& conv,
                                 const AttentionGeometry& geometry)
    : routines_(routines),
      g_(geometry),
      n_(geometry.positions()),
      reach_(geometry.fuse / 2),
      extended_(geometry.columns + 2 * reach_),
      scores_(conv, score_convolution(geometry, extended_)),
      mixture_(conv, mixture_convolution(geometry)) {}

std::array<std::int64_t, 10> AttentionStrips::sizes() const noexcept {
  return {aligned(g_.channels * n_),
          aligned(g_.channels * n_),
          aligned(n_),
          aligned(n_),
          aligned(g_.fuse * g_.fuse),
          aligned(extended_ * g_.channels * g_.patch * g_.patch),
          aligned(extended_ * n_),
          aligned(g_.fuse * g_.columns * n_),
          aligned(g_.columns * n_),
          aligned(g_.channels * g_.columns * 4 * g_.rate * g_.rate)};
}

AttentionStrips::Memory AttentionStrips::memory(std::span<std::byte> scratch) const noexcept {
  const std::array<std::int64_t, 10> counts = sizes();
  std::size_t index = 0;
  std::size_t at = 0;
  const auto next = [&] {
    std::byte* const start = scratch.data() + at;
    at += static_cast<std::size_t>(counts[index++]) * sizeof(float);
    return static_cast<float*>(static_cast<void*>(start));
  };
  Memory m{};
  m.foreground = next();
  m.background = next();
  m.inverse_norm = next();
  m.usable = next();
  m.fuse = next();
  m.patches = next();
  m.scores = next();
  m.slots = next();
  m.weights = next();
  m.mixture = next();
  m.rest = scratch.subspan(at);
  return m;
}

std::size_t AttentionStrips::scratch_bytes() const noexcept {
  std::int64_t count = 0;
  for (const std::int64_t size : sizes()) count += size;
  return static_cast<std::size_t>(count) * sizeof(float) +
         std::max(convolution_bytes(scores_), convolution_bytes(mixture_));
}

double AttentionStrips::error_factor() const noexcept {
  const auto n = static_cast<double>(n_);
  const auto width = static_cast<double>(routines_.width);
  const auto taps = static_cast<double>(g_.fuse * g_.fuse);
  const double score = scores_.error_factor() + 2 + 2 * (taps + 1) + 2;
  const double sum = static_cast<double>(kSumBlock) + std::log2(width) +
                     std::ceil(n / width / static_cast<double>(kSumBlock)) + 1;
  const double weight = 2 * std::log(n) + 4 + sum + 3;
  return 1.1 * std::max(score + 3, weight + mixture_.error_factor() + 3);
}

void AttentionStrips::convolve(const Conv2dGemm& method, const float* x, const float* weight, float* y,
                               std::span<std::byte> memory) {
  method.pack(weight, memory.data());
  method.run({x, memory.data(), nullptr, nullptr, y}, memory.subspan(packed_bytes(method)));
}

void AttentionStrips::prepare(const float* foreground, const float* background, const float* mask,
                              const float* fuse_weight, const Memory& m) const {
  const std::int64_t reach = g_.patch / 2;
  for (std::int64_t c = 0; c < g_.channels; ++c)
    for (std::int64_t p = 0; p < n_; ++p) {
      const std::int64_t from = c * g_.plane() + (p / g_.columns * g_.width + p % g_.columns) * g_.rate;
      m.foreground[c * n_ + p] = foreground[from];
      m.background[c * n_ + p] = background[from];
    }
  for (std::int64_t k = 0; k < g_.fuse * g_.fuse; ++k)
    m.fuse[k] = fuse_weight != nullptr ? fuse_weight[k] : (k / g_.fuse == k % g_.fuse ? 1.0F : 0.0F);
  parallel_for(n_, [&](std::int64_t l) {
    const std::int64_t i = l / g_.columns;
    const std::int64_t j = l % g_.columns;
    double squares = 0;
    double masked = 0;
    for (std::int64_t u = std::max<std::int64_t>(i - reach, 0); u <= std::min(i + reach, g_.rows - 1); ++u)
      for (std::int64_t v = std::max<std::int64_t>(j - reach, 0); v <= std::min(j + reach, g_.columns - 1);
           ++v) {
        masked += static_cast<double>(mask[u * g_.mask_step_y * g_.mask_width + v * g_.mask_step_x]);
        for (std::int64_t c = 0; c < g_.channels; ++c) {
          const auto value = static_cast<double>(m.background[c * n_ + u * g_.columns + v]);
          squares += value * value;
        }
      }
    m.inverse_norm[l] = static_cast<float>(1 / std::max(std::sqrt(squares), 1e-4));
    m.usable[l] = masked == 0 ? 1.0F : 0.0F;
  });
}

/// fused[x] = the row of position (row, x) after fusing in row-major order.
void AttentionStrips::score_strip(std::int64_t row, float* fused, const Memory& m) const {
  const std::int64_t reach = g_.patch / 2;
  const std::int64_t size = g_.channels * g_.patch * g_.patch;
  parallel_for(extended_, [&](std::int64_t q) {
    const std::int64_t p = row * g_.columns + q - reach_;
    float* patch = m.patches + q * size;
    std::fill_n(patch, size, 0.0F);
    if (p < 0 || p >= n_) return;
    const std::int64_t i = p / g_.columns - reach;
    const std::int64_t j = p % g_.columns - reach;
    for (std::int64_t k = 0; k < size; ++k) {
      const std::int64_t u = i + k / g_.patch % g_.patch;
      const std::int64_t v = j + k % g_.patch;
      if (u >= 0 && u < g_.rows && v >= 0 && v < g_.columns)
        patch[k] = m.foreground[k / (g_.patch * g_.patch) * n_ + u * g_.columns + v];
    }
  });
  convolve(scores_, m.background, m.patches, m.scores, m.rest);
  parallel_for(extended_,
               [&](std::int64_t q) { routines_.multiply(1.0F, m.inverse_norm, m.scores + q * n_, n_); });
  parallel_for(g_.columns, [&](std::int64_t x) {
    float* to = fused + x * n_;
    std::fill_n(to, n_, 0.0F);
    for (std::int64_t u = 0; u < g_.fuse; ++u)
      for (std::int64_t v = 0; v < g_.fuse; ++v) {
        const std::int64_t shift = u - reach_;
        const std::int64_t first = std::max<std::int64_t>(-shift, 0);
        const std::int64_t last = std::min(n_ - shift, n_);
        const float weight = m.fuse[u * g_.fuse + v];
        if (weight != 0 && first < last)
          routines_.add_scaled(weight, m.scores + (x + v) * n_ + first + shift, to + first, last - first);
      }
  });
}

/// m.weights[x] = the row of position (row, x) after fusing in column-major order, too. `strips` are those of
/// the rows one meets from -reach to +reach.
void AttentionStrips::fuse_columns(std::int64_t row, const std::vector<const float*>& strips,
                                   const Memory& m) const {
  const auto add_tap = [&](float weight, std::int64_t step, const float* from, float* to) {
    for (std::int64_t i = 0; i < g_.rows; ++i) {
      const ColumnStep s = column_step(i, step, g_.rows);
      const std::int64_t first = std::max<std::int64_t>(-s.columns_moved, 0);
      const std::int64_t last = std::min(g_.columns - s.columns_moved, g_.columns);
      if (first < last)
        routines_.add_scaled(weight, from + s.row * g_.columns + first + s.columns_moved,
                             to + i * g_.columns + first, last - first);
    }
  };
  parallel_for(g_.columns, [&](std::int64_t x) {
    float* to = m.weights + x * n_;
    std::fill_n(to, n_, 0.0F);
    for (std::int64_t u = 0; u < g_.fuse; ++u)
      for (std::int64_t v = 0; v < g_.fuse; ++v) {
        const std::int64_t column = x + column_step(row, v - reach_, g_.rows).columns_moved;
        const float weight = m.fuse[u * g_.fuse + v];
        if (weight != 0 && column >= 0 && column < g_.columns)
          add_tap(weight, u - reach_, strips[static_cast<std::size_t>(v)] + column * n_, to);
      }
  });
}

void AttentionStrips::softmax(const Memory& m) const {
  parallel_for(g_.columns, [&](std::int64_t x) {
    float* row = m.weights + x * n_;
    routines_.multiply(static_cast<float>(g_.softmax_scale), m.usable, row, n_);
    const float sum = routines_.exponentials(routines_.largest(row, n_), row, n_);
    routines_.multiply(1.0F / sum, m.usable, row, n_);
  });
}

void AttentionStrips::paste(std::int64_t row, const float* background, float* y, const Memory& m) const {
  convolve(mixture_, background, m.weights, m.mixture, m.rest);
  const std::int64_t side = 2 * g_.rate;
  parallel_for(g_.channels, [&](std::int64_t c) {
    for (std::int64_t k = 0; k < g_.columns * side * side; ++k) {
      const std::int64_t i = row * g_.rate - g_.rate / 2 + k / side % side;
      const std::int64_t j = k / (side * side) * g_.rate - g_.rate / 2 + k % side;
      if (i >= 0 && i < g_.height && j >= 0 && j < g_.width)
        y[c * g_.plane() + i * g_.width + j] += m.mixture[c * g_.columns * side * side + k] / 4;
    }
  });
}

void AttentionStrips::run(const float* foreground, const float* background, const float* mask,
                          const float* fuse_weight, float* y, std::span<std::byte> scratch) const {
  const Memory m = memory(scratch);
  prepare(foreground, background, mask, fuse_weight, m);
  std::fill_n(y, g_.channels * g_.plane(), 0.0F);
  std::vector<std::int64_t> rows_held(static_cast<std::size_t>(g_.fuse), -1);
  for (std::int64_t row = 0; row < g_.rows; ++row) {
    std::vector<std::int64_t> wanted;
    for (std::int64_t step = -reach_; step <= reach_; ++step)
      wanted.push_back(column_step(row, step, g_.rows).row);
    std::vector<const float*> strips;
    for (const std::int64_t w : wanted) {
      auto slot = std::ranges::find(rows_held, w);
      const bool held = slot != rows_held.end();
      if (!held)
        slot = std::ranges::find_if(
            rows_held, [&](std::int64_t r) { return std::ranges::find(wanted, r) == wanted.end(); });
      float* strip = m.slots + (slot - rows_held.begin()) * g_.columns * n_;
      if (!held) score_strip(w, strip, m);
      *slot = w;
      strips.push_back(strip);
    }
    fuse_columns(row, strips, m);
    softmax(m);
    paste(row, background, y, m);
  }
}

}  // namespace slide::ops
