// Tile by tile. The values of a tile and its surroundings are sorted once; from then on a pixel is its rank,
// and a window the set of its pixels' ranks, a bit each. A window that moves by one column drops a column's
// bits and takes up another's; the median is found by counting bits from where the last one was.

#include <algorithm>
#include <bit>
#include <cmath>
#include <vector>

#include "ops/common/elements.h"
#include "ops/edges/median_op.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kTile = 64;

/// Float32 numbers as integers of the same order, NaN last.
std::uint32_t ordered(float x) {
  if (std::isnan(x)) return UINT32_MAX;
  const auto bits = std::bit_cast<std::uint32_t>(x);
  return (bits >> 31) != 0 ? ~bits : bits | 0x80000000U;
}

/// A set of ranks, and its element number `wanted`.
class RankSet {
 public:
  RankSet(std::size_t ranks, std::int64_t wanted) : bits_((ranks + 63) / 64, 0), wanted_(wanted) {}

  void clear() {
    std::ranges::fill(bits_, 0);
    below_ = 0;
  }
  /// Adds a rank that is not in the set, or removes one that is.
  void toggle(std::uint32_t rank) {
    const std::uint64_t bit = std::uint64_t{1} << (rank % 64);
    bits_[rank / 64] ^= bit;
    const std::int64_t change = (bits_[rank / 64] & bit) != 0 ? 1 : -1;
    below_ += rank / 64 < word_ ? change : 0;
  }
  [[nodiscard]] std::size_t find() {
    while (below_ > wanted_) below_ -= std::popcount(bits_[--word_]);
    while (below_ + std::popcount(bits_[word_]) <= wanted_) below_ += std::popcount(bits_[word_++]);
    std::uint64_t word = bits_[word_];
    for (std::int64_t k = below_; k < wanted_; ++k) word &= word - 1;
    return word_ * 64 + static_cast<std::size_t>(std::countr_zero(word));
  }

 private:
  std::vector<std::uint64_t> bits_;
  std::int64_t wanted_;
  std::size_t word_ = 0;
  std::int64_t below_ = 0;  ///< elements in the words before word_
};

/// A tile of outputs from (top, left) and the ranks of the pixels around it.
class Tile {
 public:
  Tile(const float* plane, const Nchw& s, std::int64_t radius, std::int64_t top, std::int64_t left)
      : s_(s),
        radius_(radius),
        top_(top),
        left_(left),
        height_(std::min(kTile, s.h - top)),
        width_(std::min(kTile, s.w - left)),
        row_(width_ + 2 * radius) {
    std::vector<std::uint64_t> order;
    for (std::int64_t i = -radius; i < height_ + radius; ++i)
      for (std::int64_t j = -radius; j < width_ + radius; ++j) {
        const float x = plane[std::clamp<std::int64_t>(top + i, 0, s.h - 1) * s.w +
                              std::clamp<std::int64_t>(left + j, 0, s.w - 1)];
        order.push_back(std::uint64_t{ordered(x)} << 32 | values_.size());
        values_.push_back(x);
      }
    std::ranges::sort(order);
    ranks_.resize(values_.size());
    sorted_.resize(values_.size());
    for (std::size_t k = 0; k < order.size(); ++k) {
      const auto at = static_cast<std::size_t>(order[k] & UINT32_MAX);
      ranks_[at] = static_cast<std::uint32_t>(k);
      sorted_[k] = values_[at];
    }
  }

  void run(float* plane) const {
    const std::int64_t side = 2 * radius_ + 1;
    RankSet window(values_.size(), side * side / 2);
    const auto toggle_column = [&](std::int64_t i, std::int64_t j) {
      for (std::int64_t u = 0; u < side; ++u)
        window.toggle(ranks_[static_cast<std::size_t>((i + u) * row_ + j)]);
    };
    for (std::int64_t i = 0; i < height_; ++i) {
      window.clear();
      for (std::int64_t v = 0; v < side; ++v) toggle_column(i, v);
      float* y = plane + (top_ + i) * s_.w + left_;
      for (std::int64_t j = 0; j < width_; ++j) {
        y[j] = sorted_[window.find()];
        if (j + 1 == width_) break;
        toggle_column(i, j);
        toggle_column(i, j + side);
      }
    }
  }

 private:
  const Nchw& s_;
  std::int64_t radius_, top_, left_, height_, width_;
  std::int64_t row_;  ///< pixels of a row of the tile with its surroundings
  std::vector<float> values_, sorted_;
  std::vector<std::uint32_t> ranks_;
};

class MedianKernel : public Kernel {
 public:
  [[nodiscard]] std::string_view name() const override { return "median.ranks"; }
  [[nodiscard]] Isa isa() const override { return Isa::kBaseline; }
  [[nodiscard]] bool supports(const Op& /*op*/, std::span<const Shape> /*inputs*/,
                              const Shape& /*output*/) const override {
    return true;
  }
  /// One of the values.
  [[nodiscard]] double error_factor(const Op& /*op*/, std::span<const Shape> /*inputs*/) const override {
    return 0;
  }

  void run(const Op& op, std::span<const Tensor> inputs, Tensor& output,
           const KernelCall& /*call*/) const override {
    const std::int64_t radius = static_cast<const MedianOp&>(op).radius();
    const Nchw s = nchw(output.shape());
    const std::int64_t down = (s.h + kTile - 1) / kTile;
    const std::int64_t across = (s.w + kTile - 1) / kTile;
    for_ranges(s.n * s.c * down * across, 1, [&](std::int64_t task, std::int64_t) {
      const std::int64_t plane = task / (down * across) * s.plane();
      const std::int64_t tile = task % (down * across);
      Tile(f32(inputs[0]) + plane, s, radius, tile / across * kTile, tile % across * kTile)
          .run(f32(output) + plane);
    });
  }
};

const MedianKernel kMedian;
const Kernel* const kKernels[] = {&kMedian};

}  // namespace

std::span<const Kernel* const> MedianOp::kernels() const { return kKernels; }

}  // namespace slide::ops
