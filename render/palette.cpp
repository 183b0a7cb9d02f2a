#include "render/palette.h"

#include <algorithm>
#include <limits>

#include "runtime/threads.h"

namespace slide {
namespace {

// Differences are weighed by how visible they are; a cheap stand-in for a perceptual space.
constexpr std::array<int, 3> kWeight = {3, 5, 2};
constexpr std::array<double, 3> kLuma = {0.2126, 0.7152, 0.0722};
constexpr int kKMeansRounds = 8;

struct Entry {
  std::array<double, 3> colour{};
  double count = 0;
};

double luma(const Rgb8& c) { return kLuma[0] * c[0] + kLuma[1] * c[1] + kLuma[2] * c[2]; }

std::uint8_t rounded(double v) { return static_cast<std::uint8_t>(std::clamp(v + 0.5, 0.0, 255.0)); }

/// Weight, mean and weighted squared deviation of a range of entries, added one at a time.
struct Moments {
  double count = 0;
  std::array<double, 3> sum{};
  std::array<double, 3> square{};

  void add(const Entry& e, double sign = 1) {
    count += sign * e.count;
    for (std::size_t c = 0; c < 3; ++c) {
      sum[c] += sign * e.count * e.colour[c];
      square[c] += sign * e.count * e.colour[c] * e.colour[c];
    }
  }
  [[nodiscard]] double deviation(std::size_t c) const {
    return count > 0 ? kWeight[c] * (square[c] - sum[c] * sum[c] / count) : 0;
  }
  [[nodiscard]] double deviation() const { return deviation(0) + deviation(1) + deviation(2); }
};

struct Box {
  std::span<Entry> entries;
  Moments moments;
};

Box make_box(std::span<Entry> entries) {
  Box box{entries, {}};
  for (const Entry& e : entries) box.moments.add(e);
  return box;
}

/// Splits along the axis of the largest deviation, where the two halves deviate least in sum.
std::array<Box, 2> split(Box& box) {
  std::size_t axis = 0;
  for (std::size_t c = 1; c < 3; ++c) {
    if (box.moments.deviation(c) > box.moments.deviation(axis)) axis = c;
  }
  std::sort(box.entries.begin(), box.entries.end(),
            [axis](const Entry& a, const Entry& b) { return a.colour[axis] < b.colour[axis]; });
  Moments left;
  Moments right = box.moments;
  std::size_t best = 1;
  double best_deviation = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < box.entries.size(); ++i) {
    left.add(box.entries[i - 1]);
    right.add(box.entries[i - 1], -1);
    const double deviation = left.deviation() + right.deviation();
    if (deviation < best_deviation) {
      best_deviation = deviation;
      best = i;
    }
  }
  return {make_box(box.entries.first(best)), make_box(box.entries.subspan(best))};
}

std::vector<Entry> occupied(const ColourHistogram& histogram) {
  std::vector<Entry> entries;
  for (const auto& cell : histogram.cells()) {
    if (cell.count == 0) continue;
    Entry e;
    e.count = static_cast<double>(cell.count);
    for (std::size_t c = 0; c < 3; ++c) e.colour[c] = static_cast<double>(cell.sum[c]) / e.count;
    entries.push_back(e);
  }
  return entries;
}

std::vector<std::array<double, 3>> box_means(std::vector<Entry>& entries, std::size_t size) {
  std::vector<Box> boxes = {make_box(entries)};
  while (boxes.size() < size) {
    const auto worst = std::max_element(boxes.begin(), boxes.end(), [](const Box& a, const Box& b) {
      const double da = a.entries.size() > 1 ? a.moments.deviation() : -1;
      const double db = b.entries.size() > 1 ? b.moments.deviation() : -1;
      return da < db;
    });
    if (worst->entries.size() < 2) break;
    const std::array<Box, 2> halves = split(*worst);
    *worst = halves[0];
    boxes.push_back(halves[1]);
  }
  std::vector<std::array<double, 3>> means;
  for (const Box& box : boxes) {
    auto& mean = means.emplace_back();
    for (std::size_t c = 0; c < 3; ++c) mean[c] = box.moments.sum[c] / box.moments.count;
  }
  return means;
}

std::size_t nearest_mean(const std::vector<std::array<double, 3>>& means,
                         const std::array<double, 3>& colour) {
  std::size_t best = 0;
  double best_distance = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < means.size(); ++k) {
    double distance = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      distance += kWeight[c] * (means[k][c] - colour[c]) * (means[k][c] - colour[c]);
    }
    if (distance < best_distance) {
      best_distance = distance;
      best = k;
    }
  }
  return best;
}

void move_to_cluster_means(const std::vector<Entry>& entries, std::vector<std::array<double, 3>>& means) {
  std::vector<std::size_t> cluster(entries.size());
  for (int round = 0; round < kKMeansRounds; ++round) {
    parallel_for(static_cast<std::int64_t>(entries.size()), [&](std::int64_t i) {
      const auto e = static_cast<std::size_t>(i);
      cluster[e] = nearest_mean(means, entries[e].colour);
    });
    std::vector<Moments> moments(means.size());
    for (std::size_t i = 0; i < entries.size(); ++i) moments[cluster[i]].add(entries[i]);
    for (std::size_t k = 0; k < means.size(); ++k) {
      if (moments[k].count <= 0) continue;
      for (std::size_t c = 0; c < 3; ++c) means[k][c] = moments[k].sum[c] / moments[k].count;
    }
  }
}

constexpr int kKeyBits = 7;

std::uint32_t key_of(const std::uint8_t* rgb) {
  return static_cast<std::uint32_t>(rgb[0] >> 1) << 14U | static_cast<std::uint32_t>(rgb[1] >> 1) << 7U |
         static_cast<std::uint32_t>(rgb[2] >> 1);
}

/// The channel value a key stands for: 0..127 spread over 0..255, both ends exact.
int channel_of(std::uint32_t key, unsigned shift) {
  const unsigned v = key >> shift & 127U;
  return static_cast<int>(v << 1U | v >> 6U);
}

/// The 8×8 Bayer matrix, 0..63: the bits of y and x^y interleaved, least significant first.
unsigned bayer(unsigned x, unsigned y) {
  unsigned value = 0;
  for (unsigned bit = 0; bit < 3; ++bit) {
    value = value << 2U | ((x ^ y) >> bit & 1U) << 1U | (y >> bit & 1U);
  }
  return value;
}

}  // namespace

void ColourHistogram::add(std::span<const std::uint8_t> rgb) {
  for (std::size_t i = 0; i + 2 < rgb.size(); i += 3) {
    Cell& cell =
        cells_[static_cast<std::size_t>(rgb[i] >> 3) << 10U |
               static_cast<std::size_t>(rgb[i + 1] >> 3) << 5U | static_cast<std::size_t>(rgb[i + 2] >> 3)];
    ++cell.count;
    for (std::size_t c = 0; c < 3; ++c) cell.sum[c] += rgb[i + c];
  }
}

std::vector<Rgb8> make_palette(const ColourHistogram& histogram, int size) {
  std::vector<Entry> entries = occupied(histogram);
  if (entries.empty()) return {Rgb8{0, 0, 0}};
  std::vector<std::array<double, 3>> means = box_means(entries, static_cast<std::size_t>(size));
  move_to_cluster_means(entries, means);
  std::vector<Rgb8> palette;
  palette.reserve(means.size());
  for (const auto& m : means) palette.push_back({rounded(m[0]), rounded(m[1]), rounded(m[2])});
  std::sort(palette.begin(), palette.end(), [](const Rgb8& a, const Rgb8& b) {
    const double la = luma(a);
    const double lb = luma(b);
    return la < lb || (la == lb && a < b);
  });
  palette.erase(std::unique(palette.begin(), palette.end()), palette.end());
  return palette;
}

PatternDither::PatternDither(std::vector<Rgb8> palette)
    : palette_(std::move(palette)),
      table_(std::size_t{1} << (3 * kKeyBits)),
      ready_(std::size_t{1} << (3 * kKeyBits), 0) {
  for (std::size_t c = 0; c < 3; ++c) {
    for (const Rgb8& p : palette_) planes_[c].push_back(p[c]);
  }
}

std::uint8_t PatternDither::nearest(const std::array<int, 3>& colour) const {
  // Distance and index in one number, so that the compiler can make a vector minimum of it. The largest
  // distance, 10 · 382², fits into 23 bits beside the 8 of the index.
  std::int32_t best = std::numeric_limits<std::int32_t>::max();
  const std::int32_t* r = planes_[0].data();
  const std::int32_t* g = planes_[1].data();
  const std::int32_t* b = planes_[2].data();
  const auto n = static_cast<std::int32_t>(palette_.size());
  for (std::int32_t i = 0; i < n; ++i) {
    const std::int32_t dr = r[i] - colour[0];
    const std::int32_t dg = g[i] - colour[1];
    const std::int32_t db = b[i] - colour[2];
    const std::int32_t distance = kWeight[0] * dr * dr + kWeight[1] * dg * dg + kWeight[2] * db * db;
    best = std::min(best, distance * 256 + i);
  }
  return static_cast<std::uint8_t>(best & 255);
}

PatternDither::Candidates PatternDither::candidates_for(std::uint32_t key) const {
  const std::array<int, 3> colour = {channel_of(key, 14), channel_of(key, 7), channel_of(key, 0)};
  std::array<int, 3> error{};
  Candidates found{};
  for (auto& candidate : found) {
    std::array<int, 3> wanted{};
    // Three quarters of the error are carried: less contrast in the pattern for a mean that is nearly as
    // close. The bounds keep a colour outside of the palette's hull from running away.
    for (std::size_t c = 0; c < 3; ++c) wanted[c] = std::clamp(colour[c] + error[c] * 3 / 4, -127, 382);
    candidate = nearest(wanted);
    for (std::size_t c = 0; c < 3; ++c)
      error[c] = std::clamp(error[c] + colour[c] - palette_[candidate][c], -255, 255);
  }
  std::sort(found.begin(), found.end());  // the palette is in the order of luma
  return found;
}

void PatternDither::prepare(std::span<const std::uint8_t> rgb) {
  std::vector<std::uint32_t> fresh;
  for (std::size_t i = 0; i + 2 < rgb.size(); i += 3) {
    const std::uint32_t key = key_of(rgb.data() + i);
    if (ready_[key] != 0) continue;
    ready_[key] = 1;
    fresh.push_back(key);
  }
  constexpr std::size_t kBatch = 256;
  parallel_for(static_cast<std::int64_t>((fresh.size() + kBatch - 1) / kBatch), [&](std::int64_t batch) {
    const std::size_t first = static_cast<std::size_t>(batch) * kBatch;
    for (std::size_t i = first; i < std::min(first + kBatch, fresh.size()); ++i) {
      table_[fresh[i]] = candidates_for(fresh[i]);
    }
  });
}

void PatternDither::map(std::span<const std::uint8_t> rgb, int width, std::span<std::uint8_t> indices) {
  prepare(rgb);
  const auto w = static_cast<std::size_t>(width);
  const std::size_t height = w == 0 ? 0 : indices.size() / w;
  for (std::size_t y = 0; y < height; ++y) {
    std::array<std::size_t, 8> pick{};
    for (unsigned x = 0; x < 8; ++x) pick[x] = bayer(x, static_cast<unsigned>(y) & 7U) * kCandidates / 64;
    for (std::size_t x = 0; x < w; ++x) {
      const std::size_t i = y * w + x;
      indices[i] = table_[key_of(rgb.data() + 3 * i)][pick[x & 7U]];
    }
  }
}

}  // namespace slide
