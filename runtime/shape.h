#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <span>
#include <string>

namespace slide {

/// The extents of a tensor: rank 0 to 5, row-major, every extent >= 0. Rank 0 is a scalar with one element.
class Shape {
 public:
  static constexpr int kMaxRank = 5;

  Shape() = default;
  /// Throws Error(kInternal) if there are more than five extents, one is negative, or the number of elements
  /// does not fit into 62 bits.
  Shape(std::initializer_list<std::int64_t> extents);
  explicit Shape(std::span<const std::int64_t> extents);

  [[nodiscard]] int rank() const noexcept { return rank_; }
  /// Extent of an axis; a negative axis counts from the end. Throws Error(kInternal) if there is no such
  /// axis.
  [[nodiscard]] std::int64_t operator[](int axis) const;
  /// The number of elements.
  [[nodiscard]] std::int64_t count() const noexcept { return count_; }
  [[nodiscard]] std::span<const std::int64_t> extents() const noexcept {
    return {extents_.data(), static_cast<std::size_t>(rank_)};
  }
  /// The same shape with one extent replaced.
  [[nodiscard]] Shape with(int axis, std::int64_t extent) const;
  /// "1x3x384x512"; "scalar" for rank 0.
  [[nodiscard]] std::string text() const;

  friend bool operator==(const Shape& a, const Shape& b) noexcept {
    return a.rank_ == b.rank_ && a.extents_ == b.extents_;
  }

 private:
  [[nodiscard]] std::size_t axis_index(int axis) const;

  std::array<std::int64_t, kMaxRank> extents_{};
  int rank_ = 0;
  std::int64_t count_ = 1;
};

}  // namespace slide
