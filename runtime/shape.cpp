#include "runtime/shape.h"

#include <algorithm>

#include "runtime/error.h"

namespace slide {

Shape::Shape(std::initializer_list<std::int64_t> extents)
    : Shape(std::span<const std::int64_t>(extents.begin(), extents.size())) {}

Shape::Shape(std::span<const std::int64_t> extents) {
  if (extents.size() > static_cast<std::size_t>(kMaxRank))
    throw Error(ErrorKind::kInternal, "a tensor of rank " + std::to_string(extents.size()) +
                                          " was asked for; the largest rank is " + std::to_string(kMaxRank));
  rank_ = static_cast<int>(extents.size());
  std::copy(extents.begin(), extents.end(), extents_.begin());
  constexpr std::int64_t kLimit = std::int64_t{1} << 62;
  bool has_zero = false;
  for (const std::int64_t e : extents) {
    if (e < 0) throw Error(ErrorKind::kInternal, "a shape has the negative extent " + std::to_string(e));
    has_zero = has_zero || e == 0;
    if (e > 0 && __builtin_mul_overflow(count_, e, &count_)) count_ = kLimit;
    if (count_ >= kLimit)
      throw Error(ErrorKind::kInternal, "the shape " + text() + " has more elements than can be counted");
  }
  if (has_zero) count_ = 0;
}

std::size_t Shape::axis_index(int axis) const {
  const int index = axis < 0 ? axis + rank_ : axis;
  if (index < 0 || index >= rank_)
    throw Error(ErrorKind::kInternal, "axis " + std::to_string(axis) + " of a tensor of shape " + text());
  return static_cast<std::size_t>(index);
}

std::int64_t Shape::operator[](int axis) const { return extents_[axis_index(axis)]; }

Shape Shape::with(int axis, std::int64_t extent) const {
  std::array<std::int64_t, kMaxRank> changed = extents_;
  changed[axis_index(axis)] = extent;
  return Shape(std::span<const std::int64_t>(changed.data(), static_cast<std::size_t>(rank_)));
}

std::string Shape::text() const {
  if (rank_ == 0) return "scalar";
  std::string out;
  for (const std::int64_t e : extents()) out += (out.empty() ? "" : "x") + std::to_string(e);
  return out;
}

}  // namespace slide
