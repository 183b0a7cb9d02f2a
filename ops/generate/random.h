#pragma once

#include <cstdint>
#include <initializer_list>
#include <string_view>

namespace slide::ops {

/// Numbers that depend on what they are for and on nothing else: the same on every machine (SplitMix64,
/// Steele, Lea and Flood, "Fast Splittable Pseudorandom Number Generators", OOPSLA 2014).
class Random {
 public:
  Random(std::string_view what, std::uint64_t seed, std::uint64_t index)
      : state_(seed * 0x2545F4914F6CDD1DULL + index) {
    for (const char c : what) state_ = next() ^ static_cast<std::uint64_t>(c);
  }

  std::uint64_t next() {
    state_ += 0x9E3779B97F4A7C15ULL;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31U);
  }
  /// In [0, 1).
  double real() { return static_cast<double>(next() >> 11U) * 0x1p-53; }
  /// In [least, most].
  std::int64_t integer(std::int64_t least, std::int64_t most) {
    return least + static_cast<std::int64_t>(next() % static_cast<std::uint64_t>(most - least + 1));
  }
  bool chance(double probability) { return real() < probability; }
  /// Of a normal distribution, nearly: twelve uniform numbers.
  double normal() {
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += real();
    return sum;
  }
  template <typename T>
  T pick(std::initializer_list<T> choices) {
    return choices.begin()[integer(0, static_cast<std::int64_t>(choices.size()) - 1)];
  }

 private:
  std::uint64_t state_;
};

}  // namespace slide::ops
