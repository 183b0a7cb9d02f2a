#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace slide {

using Rgb8 = std::array<std::uint8_t, 3>;

/// How often the colours of some images occur, on a 32×32×32 grid that keeps the mean colour of each cell.
class ColourHistogram {
 public:
  ColourHistogram() : cells_(32 * 32 * 32) {}
  /// @param rgb  3 bytes a pixel
  void add(std::span<const std::uint8_t> rgb);

  struct Cell {
    std::uint64_t count = 0;
    std::array<std::uint64_t, 3> sum{};
  };
  [[nodiscard]] const std::vector<Cell>& cells() const noexcept { return cells_; }

 private:
  std::vector<Cell> cells_;
};

/// At most `size` colours (1..256) that represent the histogram: boxes are split where the weighted variance
/// falls most (Wu, "Efficient statistical computations for optimal color quantization", Graphics Gems II,
/// 1991), then moved by a few rounds of k-means. Fewer colours come out where fewer occur. Sorted by luma.
[[nodiscard]] std::vector<Rgb8> make_palette(const ColourHistogram& histogram, int size);

/// Maps images to a palette with an ordered dither: which palette colour a pixel gets depends only on its
/// colour and its place, so that what does not move does not flicker from frame to frame. For each colour 16
/// palette colours are found whose mean is close to it, ordered by luma, and an 8×8 Bayer matrix picks among
/// them (Knoll, "Pattern dithering", US patent 6,606,166, expired). Colours are told apart by their upper 7
/// bits.
class PatternDither {
 public:
  explicit PatternDither(std::vector<Rgb8> palette);

  /// indices[i] = palette index of pixel i; rgb holds 3 bytes a pixel.
  void map(std::span<const std::uint8_t> rgb, int width, std::span<std::uint8_t> indices);

 private:
  static constexpr int kCandidates = 16;
  using Candidates = std::array<std::uint8_t, kCandidates>;

  void prepare(std::span<const std::uint8_t> rgb);
  [[nodiscard]] Candidates candidates_for(std::uint32_t key) const;
  [[nodiscard]] std::uint8_t nearest(const std::array<int, 3>& colour) const;

  std::vector<Rgb8> palette_;
  std::array<std::vector<std::int32_t>, 3> planes_;  // the palette by channel, for the search
  std::vector<Candidates> table_;                    // by colour key
  std::vector<std::uint8_t> ready_;                  // which of them have been computed
};

}  // namespace slide
