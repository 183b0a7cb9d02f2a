#include "render/cutout.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

namespace slide {
namespace {

/// One level: colours where `weight` says so.
struct Level {
  Image colour;
  Image weight;
};

/// The next coarser level: weighted means of up to 2×2 pixels, whose weights saturate at 1.
Level pulled(const Level& fine) {
  const int width = (fine.colour.width + 1) / 2;
  const int height = (fine.colour.height + 1) / 2;
  const int channels = fine.colour.channels;
  Level coarse{Image(width, height, channels), Image(width, height, 1)};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      double sum = 0;
      std::array<double, 4> colours{};  // in double: maps may lie at the end of float's range
      for (int v = 2 * y; v < std::min(2 * y + 2, fine.colour.height); ++v)
        for (int u = 2 * x; u < std::min(2 * x + 2, fine.colour.width); ++u) {
          const double w = fine.weight.at(u, v);
          sum += w;
          for (int c = 0; c < channels; ++c)
            colours[static_cast<std::size_t>(c)] += w * static_cast<double>(fine.colour.at(u, v, c));
        }
      coarse.weight.at(x, y) = static_cast<float>(std::min(sum, 1.0));
      for (int c = 0; c < channels; ++c)
        coarse.colour.at(x, y, c) =
            sum > 0 ? static_cast<float>(colours[static_cast<std::size_t>(c)] / sum) : 0;
    }
  return coarse;
}

/// The two pixels of a coarse row or column between which a fine one lies, and the second one's share.
struct Between {
  int first, second;
  float share;
};

Between between(int fine, int coarse_size) {
  const float place =
      std::clamp((static_cast<float>(fine) - 0.5F) / 2, 0.0F, static_cast<float>(coarse_size - 1));
  const int first = static_cast<int>(place);
  return {first, std::min(first + 1, coarse_size - 1), place - static_cast<float>(first)};
}

/// Puts the coarse level, enlarged bilinearly, behind the fine one.
void push(const Image& coarse, Level& fine) {
  for (int y = 0; y < fine.colour.height; ++y) {
    const Between v = between(y, coarse.height);
    for (int x = 0; x < fine.colour.width; ++x) {
      const float w = fine.weight.at(x, y);
      if (w >= 1) continue;
      const Between u = between(x, coarse.width);
      for (int c = 0; c < coarse.channels; ++c) {
        const float upper =
            (1 - u.share) * coarse.at(u.first, v.first, c) + u.share * coarse.at(u.second, v.first, c);
        const float lower =
            (1 - u.share) * coarse.at(u.first, v.second, c) + u.share * coarse.at(u.second, v.second, c);
        const float behind = (1 - v.share) * upper + v.share * lower;
        float& colour = fine.colour.at(x, y, c);
        colour = w * colour + (1 - w) * behind;
      }
    }
  }
}

}  // namespace

Image over_own_colours(const Image& colour, const Image& alpha) {
  std::vector<Level> levels = {{colour, alpha}};
  while (levels.back().colour.width > 1 || levels.back().colour.height > 1)
    levels.push_back(pulled(levels.back()));
  for (std::size_t i = levels.size() - 1; i-- > 0;) push(levels[i + 1].colour, levels[i]);
  return std::move(levels[0].colour);
}

}  // namespace slide
