#include "ops/attention/attention_strips.h"

#include <algorithm>
#include <cmath>

#include "runtime/threads.h"

namespace slide::ops {
namespace {

/// A matrix product: `filters` × `depth` times `depth` × `columns`.
Conv2dGeometry product(std::int64_t filters, std::int64_t depth, std::int64_t columns) {
  Conv2dGeometry c{};
  c.batch = c.groups = 1;
  c.stride_y = c.stride_x = c.dilation_y = c.dilation_x = 1;
  c.kheight = c.kwidth = c.height = c.oheight = 1;
  c.ic = c.group_ic = depth;
  c.oc = c.group_oc = filters;
  c.width = c.owidth = columns;
  return c;
}

std::int64_t aligned(std::int64_t count) {
  return (count + kRowAlignment - 1) / kRowAlignment * kRowAlignment;
}

/// Of a product whose left side is new at each call.
std::size_t packed_bytes(const Conv2dGemm& method) {
  return (method.packed_bytes() + Tensor::kAlignment - 1) / Tensor::kAlignment * Tensor::kAlignment;
}
std::size_t product_bytes(const Conv2dGemm& method) { return packed_bytes(method) + method.scratch_bytes(); }

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
  float* foreground;          // reduced: n × channels
  float* background;          // reduced, with the margin: channels × line_count
  float* inverse_norm;        // n
  float* usable;              // n: 1 or 0
  float* fuse;                // fuse × fuse
  float* blocks;              // of the background: blocks × channels·rate²
  float* pixels;              // products of single pixels, columns × line_count
  float* lines;               // their sums along columns, patch strips
  float* scores;              // score_rows strips, columns × n
  float* fused;               // fuse strips, columns × n
  float* twice;               // columns × n
  float* weights;             // two strips, columns × weight_size
  float* zeros;               // weight_size
  float* sums;                // of four weights, (columns + 1) × blocks
  float* mixture;             // (columns + 1) × channels·rate²
  std::span<std::byte> rest;  // for the products
};

/// Some rows' strips, kept as long as those that are wanted with others leave room.
class AttentionStrips::HeldRows {
 public:
  HeldRows(float* memory, std::int64_t slots, std::int64_t strip)
      : memory_(memory), strip_(strip), rows_(static_cast<std::size_t>(slots), -1) {}

  /// The strips of the rows wanted, in their order; make(row, strip) fills those that are not there.
  template <typename Make>
  std::vector<const float*> strips(const std::vector<std::int64_t>& wanted, Make make) {
    std::vector<const float*> result;
    for (const std::int64_t row : wanted) {
      auto slot = std::ranges::find(rows_, row);
      const bool held = slot != rows_.end();
      if (!held)
        slot = std::ranges::find_if(
            rows_, [&](std::int64_t r) { return std::ranges::find(wanted, r) == wanted.end(); });
      float* strip = memory_ + (slot - rows_.begin()) * strip_;
      if (!held) make(row, strip);
      *slot = row;
      result.push_back(strip);
    }
    return result;
  }

 private:
  float* memory_;
  std::int64_t strip_;
  std::vector<std::int64_t> rows_;
};

/// Of one run.
struct AttentionStrips::Held {
  HeldRows lines, scores, fused;
};

AttentionStrips::AttentionStrips(const AttentionRoutines& routines, const Conv2dRoutines& conv,
                                 const AttentionGeometry& geometry)
    : routines_(routines),
      g_(geometry),
      n_(geometry.positions()),
      margin_(geometry.patch / 2),
      line_width_(geometry.columns + 2 * margin_),
      line_count_((geometry.rows + 2 * margin_) * line_width_),
      reach_(geometry.fuse / 2),
      score_rows_(2 * ((reach_ + geometry.columns - 1) / geometry.columns) + 1),
      weight_size_((geometry.rows + 2) * (geometry.columns + 1) + 1),
      blocks_((geometry.rows + 1) * (geometry.columns + 1)),
      pixels_(conv, product(geometry.columns, geometry.channels, line_count_), {}),
      mixture_(conv,
               product(geometry.columns + 1, blocks_, geometry.channels * geometry.rate * geometry.rate),
               {}) {}

std::array<std::int64_t, 15> AttentionStrips::sizes() const noexcept {
  const std::int64_t block = g_.channels * g_.rate * g_.rate;
  return {aligned(g_.channels * n_),
          aligned(g_.channels * line_count_),
          aligned(n_),
          aligned(n_),
          aligned(g_.fuse * g_.fuse),
          aligned(blocks_ * block),
          aligned(g_.columns * line_count_),
          aligned(g_.patch * g_.columns * line_count_),
          aligned(score_rows_ * g_.columns * n_),
          aligned(g_.fuse * g_.columns * n_),
          aligned(g_.columns * n_),
          aligned(2 * g_.columns * weight_size_),
          aligned(weight_size_),
          aligned((g_.columns + 1) * blocks_),
          aligned((g_.columns + 1) * block)};
}

AttentionStrips::Memory AttentionStrips::memory(std::span<std::byte> scratch) const noexcept {
  const auto counts = sizes();
  std::size_t index = 0;
  std::size_t at = 0;
  const auto next = [&] {
    std::byte* const start = scratch.data() + at;
    at += static_cast<std::size_t>(counts[index++]) * sizeof(float);
    return static_cast<float*>(static_cast<void*>(start));
  };
  Memory m{};
  for (float** array :
       {&m.foreground, &m.background, &m.inverse_norm, &m.usable, &m.fuse, &m.blocks, &m.pixels, &m.lines,
        &m.scores, &m.fused, &m.twice, &m.weights, &m.zeros, &m.sums, &m.mixture})
    *array = next();
  m.rest = scratch.subspan(at);
  return m;
}

std::size_t AttentionStrips::scratch_bytes() const noexcept {
  std::int64_t count = 0;
  for (const std::int64_t size : sizes()) count += size;
  return static_cast<std::size_t>(count) * sizeof(float) +
         std::max(product_bytes(pixels_), product_bytes(mixture_));
}

double AttentionStrips::error_factor() const noexcept {
  const auto n = static_cast<double>(n_);
  const auto width = static_cast<double>(routines_.width);
  const auto taps = static_cast<double>(g_.fuse * g_.fuse);
  const double sums = 2 * static_cast<double>(g_.patch - 1);
  const double score = pixels_.error_factor() + sums + 2 + 2 * (taps + 1) + 2;
  const double sum = static_cast<double>(kSumBlock) + std::log2(width) +
                     std::ceil(n / width / static_cast<double>(kSumBlock)) + 1;
  const double weight = 4 + sum + 3;
  return 1.1 * std::max(score + 3, weight + 3 + mixture_.error_factor());
}

double AttentionStrips::macs() const noexcept {
  const auto fusing = static_cast<double>(2 * g_.fuse * g_.fuse * n_) * static_cast<double>(n_);
  return static_cast<double>(g_.rows) * pixels_.macs() + static_cast<double>(g_.rows + 1) * mixture_.macs() +
         fusing;
}

void AttentionStrips::multiply(const Conv2dGemm& method, const float* x, const float* weight, float* y,
                               std::span<std::byte> memory) {
  method.pack(weight, memory.data());
  method.run({x, memory.data(), nullptr, nullptr, y}, memory.subspan(packed_bytes(method)));
}

AttentionStrips::Units AttentionStrips::units_of(const float* foreground, const float* background) const {
  constexpr float kLarge = 0x1p40F;
  const auto unit = [&](const float* x) {
    float largest = 0;
    for (std::int64_t i = 0; i < g_.channels * g_.plane(); ++i)
      if (std::isfinite(x[i])) largest = std::max(largest, std::fabs(x[i]));
    return largest > kLarge ? std::ldexp(1.0F, -std::ilogb(largest)) : 1.0F;
  };
  return {unit(foreground), unit(background)};
}

/// Every rate-th pixel; of the background with zeros around.
void AttentionStrips::reduce(const float* foreground, const float* background, const Units& units,
                             const Memory& m) const {
  parallel_for(g_.channels, [&](std::int64_t c) {
    float* padded = m.background + c * line_count_;
    std::fill_n(padded, line_count_, 0.0F);
    for (std::int64_t p = 0; p < n_; ++p) {
      const std::int64_t i = p / g_.columns;
      const std::int64_t j = p % g_.columns;
      const std::int64_t from = c * g_.plane() + (i * g_.width + j) * g_.rate;
      m.foreground[p * g_.channels + c] = foreground[from] * units.foreground;
      padded[(i + margin_) * line_width_ + j + margin_] = background[from] * units.background;
    }
  });
}

/// Blocks start rate/2 before a position's pixel, as the large patches do; zeros beyond the image.
void AttentionStrips::list_blocks(const float* background, const Memory& m) const {
  const std::int64_t area = g_.rate * g_.rate;
  parallel_for(blocks_, [&](std::int64_t block) {
    const std::int64_t top = block / (g_.columns + 1) * g_.rate - g_.rate / 2;
    const std::int64_t left = block % (g_.columns + 1) * g_.rate - g_.rate / 2;
    float* to = m.blocks + block * g_.channels * area;
    for (std::int64_t k = 0; k < g_.channels * area; ++k) {
      const std::int64_t i = top + k % area / g_.rate;
      const std::int64_t j = left + k % g_.rate;
      const bool inside = i >= 0 && i < g_.height && j >= 0 && j < g_.width;
      to[k] = inside ? background[k / area * g_.plane() + i * g_.width + j] : 0.0F;
    }
  });
}

void AttentionStrips::prepare(const float* foreground, const float* background, const float* mask,
                              const float* fuse_weight, const Units& units, const Memory& m) const {
  reduce(foreground, background, units, m);
  list_blocks(background, m);
  std::fill_n(m.zeros, weight_size_, 0.0F);
  std::fill_n(m.weights, 2 * g_.columns * weight_size_, 0.0F);
  for (std::int64_t k = 0; k < g_.fuse * g_.fuse; ++k)
    m.fuse[k] = fuse_weight != nullptr ? fuse_weight[k] : (k / g_.fuse == k % g_.fuse ? 1.0F : 0.0F);
  parallel_for(n_, [&](std::int64_t l) {
    const std::int64_t i = l / g_.columns;
    const std::int64_t j = l % g_.columns;
    double squares = 0;
    double masked = 0;
    for (std::int64_t u = std::max<std::int64_t>(i - margin_, 0); u <= std::min(i + margin_, g_.rows - 1);
         ++u)
      for (std::int64_t v = std::max<std::int64_t>(j - margin_, 0);
           v <= std::min(j + margin_, g_.columns - 1); ++v) {
        masked += static_cast<double>(mask[u * g_.mask_step_y * g_.mask_width + v * g_.mask_step_x]);
        for (std::int64_t c = 0; c < g_.channels; ++c) {
          const auto value =
              static_cast<double>(m.background[c * line_count_ + (u + margin_) * line_width_ + v + margin_]);
          squares += value * value;
        }
      }
    m.inverse_norm[l] =
        static_cast<float>(1 / std::max(std::sqrt(squares), 1e-4 * static_cast<double>(units.background)));
    m.usable[l] = masked == 0 ? 1.0F : 0.0F;
  });
}

/// lines[x]: products of single pixels added over the columns of the patches at (row, x).
void AttentionStrips::line_strip(std::int64_t row, float* lines, const Memory& m) const {
  multiply(pixels_, m.background, m.foreground + row * g_.columns * g_.channels, m.pixels, m.rest);
  parallel_for(g_.columns, [&](std::int64_t x) {
    std::vector<const float*> terms;
    for (std::int64_t v = std::max(-margin_, -x); v <= std::min(margin_, g_.columns - 1 - x); ++v)
      terms.push_back(m.pixels + (x + v) * line_count_ + margin_ + v);
    routines_.sum(terms, nullptr, lines + x * line_count_ + margin_, line_count_ - 2 * margin_);
  });
}

/// scores[x]: those of position (row, x), before fusing.
void AttentionStrips::score_strip(std::int64_t row, float* scores, HeldRows& lines, const Memory& m) const {
  std::vector<std::int64_t> wanted;
  const std::int64_t first = std::max<std::int64_t>(row - margin_, 0);
  for (std::int64_t r = first; r <= std::min(row + margin_, g_.rows - 1); ++r) wanted.push_back(r);
  const std::vector<const float*> strips =
      lines.strips(wanted, [&](std::int64_t r, float* strip) { line_strip(r, strip, m); });
  parallel_for(g_.columns, [&](std::int64_t x) {
    std::vector<const float*> terms(strips.size());
    for (std::int64_t i = 0; i < g_.rows; ++i) {
      for (std::size_t t = 0; t < terms.size(); ++t)
        terms[t] = strips[t] + x * line_count_ +
                   (i + margin_ + first + static_cast<std::int64_t>(t) - row) * line_width_ + margin_;
      routines_.sum(terms, m.inverse_norm + i * g_.columns, scores + x * n_ + i * g_.columns, g_.columns);
    }
  });
}

/// fused[x] = the row of position (row, x) after fusing in row-major order.
void AttentionStrips::fuse_strip(std::int64_t row, float* fused, Held& held, const Memory& m) const {
  std::vector<std::int64_t> wanted;
  const std::int64_t first = std::max<std::int64_t>(row - score_rows_ / 2, 0);
  for (std::int64_t r = first; r <= std::min(row + score_rows_ / 2, g_.rows - 1); ++r) wanted.push_back(r);
  const std::vector<const float*> strips =
      held.scores.strips(wanted, [&](std::int64_t r, float* strip) { score_strip(r, strip, held.lines, m); });
  parallel_for(g_.columns, [&](std::int64_t x) {
    float* to = fused + x * n_;
    std::fill_n(to, n_, 0.0F);
    for (std::int64_t u = -reach_; u <= reach_; ++u)
      for (std::int64_t v = -reach_; v <= reach_; ++v) {
        const std::int64_t p = row * g_.columns + x + v;
        const std::int64_t begin = std::max<std::int64_t>(-u, 0);
        const std::int64_t end = std::min(n_ - u, n_);
        const float weight = m.fuse[(u + reach_) * g_.fuse + v + reach_];
        if (weight == 0 || p < 0 || p >= n_ || begin >= end) continue;
        const float* from = strips[static_cast<std::size_t>(p / g_.columns - first)] + p % g_.columns * n_;
        routines_.add_scaled(weight, from + begin + u, to + begin, end - begin);
      }
  });
}

/// m.twice[x] = the row of position (row, x) after fusing in column-major order, too. `strips` are those of
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
    float* to = m.twice + x * n_;
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

float* AttentionStrips::weights_of(std::int64_t row, std::int64_t x, const Memory& m) const noexcept {
  return m.weights + (row % 2 * g_.columns + x) * weight_size_;
}

void AttentionStrips::softmax(std::int64_t row, float scale, const Memory& m) const {
  parallel_for(g_.columns, [&](std::int64_t x) {
    float* scores = m.twice + x * n_;
    routines_.multiply(scale, m.usable, scores, n_);
    const float sum = routines_.exponentials(routines_.largest(scores, n_), scores, n_);
    routines_.multiply(1.0F / sum, m.usable, scores, n_);
    float* to = weights_of(row, x, m) + g_.columns + 2;
    for (std::int64_t i = 0; i < g_.rows; ++i)
      std::copy_n(scores + i * g_.columns, g_.columns, to + i * (g_.columns + 1));
  });
}

/// The blocks of one row: each is part of the patches of four positions, which begin in it or in the blocks
/// before and above.
void AttentionStrips::paste(std::int64_t block_row, float* y, const Memory& m) const {
  parallel_for(g_.columns + 1, [&](std::int64_t x) {
    std::vector<const float*> terms;
    for (std::int64_t i = 0; i < 2; ++i)
      for (std::int64_t j = 0; j < 2; ++j) {
        const bool inside = block_row - i >= 0 && block_row - i < g_.rows && x - j >= 0 && x - j < g_.columns;
        const float* weights = inside ? weights_of(block_row - i, x - j, m) : m.zeros;
        terms.push_back(weights + (1 - i) * (g_.columns + 1) + 1 - j);
      }
    routines_.sum(terms, nullptr, m.sums + x * blocks_, blocks_);
  });
  multiply(mixture_, m.blocks, m.sums, m.mixture, m.rest);
  const std::int64_t area = g_.rate * g_.rate;
  parallel_for(g_.channels, [&](std::int64_t c) {
    for (std::int64_t k = 0; k < (g_.columns + 1) * area; ++k) {
      const std::int64_t i = block_row * g_.rate - g_.rate / 2 + k % area / g_.rate;
      const std::int64_t j = k / area * g_.rate - g_.rate / 2 + k % g_.rate;
      if (i >= 0 && i < g_.height && j >= 0 && j < g_.width)
        y[c * g_.plane() + i * g_.width + j] = m.mixture[(k / area * g_.channels + c) * area + k % area] / 4;
    }
  });
}

void AttentionStrips::run(const float* foreground, const float* background, const float* mask,
                          const float* fuse_weight, float* y, std::span<std::byte> scratch) const {
  const Memory m = memory(scratch);
  const Units units = units_of(foreground, background);
  prepare(foreground, background, mask, fuse_weight, units, m);
  Held held{{m.lines, g_.patch, g_.columns * line_count_},
            {m.scores, score_rows_, g_.columns * n_},
            {m.fused, g_.fuse, g_.columns * n_}};
  for (std::int64_t row = 0; row < g_.rows; ++row) {
    std::vector<std::int64_t> wanted;
    for (std::int64_t step = -reach_; step <= reach_; ++step)
      wanted.push_back(column_step(row, step, g_.rows).row);
    fuse_columns(
        row, held.fused.strips(wanted, [&](std::int64_t r, float* strip) { fuse_strip(r, strip, held, m); }),
        m);
    softmax(row, static_cast<float>(g_.softmax_scale) / units.foreground, m);
    paste(row, y, m);
  }
  paste(g_.rows, y, m);
}

}  // namespace slide::ops
