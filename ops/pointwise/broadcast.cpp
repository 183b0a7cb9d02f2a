#include "ops/pointwise/broadcast.h"

#include <algorithm>

#include "ops/common/op_support.h"

namespace slide::ops {
namespace {

/// The extent of an axis counted from the last, 1 beyond the first.
std::int64_t extent_from_end(const Shape& shape, int i) { return i < shape.rank() ? shape[-1 - i] : 1; }

}  // namespace

Shape broadcast_shape(const Shape& a, const Shape& b) {
  const int rank = std::max(a.rank(), b.rank());
  std::array<std::int64_t, Shape::kMaxRank> extents{};
  for (int i = 0; i < rank; ++i) {
    const std::int64_t ea = extent_from_end(a, i);
    const std::int64_t eb = extent_from_end(b, i);
    if (ea != eb && ea != 1 && eb != 1)
      throw shape_error("the shapes " + a.text() + " and " + b.text() + " do not broadcast: extents " +
                        std::to_string(ea) + " and " + std::to_string(eb));
    extents[static_cast<std::size_t>(rank - 1 - i)] = ea == 1 ? eb : ea;
  }
  return Shape(std::span<const std::int64_t>(extents.data(), static_cast<std::size_t>(rank)));
}

BroadcastRows::BroadcastRows(const Shape& a, const Shape& b, const Shape& output) {
  std::array<Axis, Shape::kMaxRank + 1> axes{};  // first varies fastest
  int count = 0;
  std::int64_t a_size = 1;
  std::int64_t b_size = 1;
  for (int i = 0; i < output.rank(); ++i) {
    const std::int64_t extent = output[-1 - i];
    if (extent == 1) continue;
    const std::int64_t ea = extent_from_end(a, i);
    const std::int64_t eb = extent_from_end(b, i);
    const Axis axis{extent, ea == 1 ? 0 : a_size, eb == 1 ? 0 : b_size};
    a_size *= ea;
    b_size *= eb;
    if (count > 0) {
      Axis& last = axes[static_cast<std::size_t>(count - 1)];
      if (axis.a_stride == last.a_stride * last.extent && axis.b_stride == last.b_stride * last.extent) {
        last.extent *= extent;
        continue;
      }
    }
    axes[static_cast<std::size_t>(count++)] = axis;
  }
  if (count == 0) return;
  length_ = axes[0].extent;
  a_step_ = axes[0].a_stride;
  b_step_ = axes[0].b_stride;
  outer_rank_ = count - 1;
  for (int i = 0; i < outer_rank_; ++i) {
    outer_[static_cast<std::size_t>(i)] = axes[static_cast<std::size_t>(count - 1 - i)];
    rows_ *= outer_[static_cast<std::size_t>(i)].extent;
  }
}

BroadcastRows::Start BroadcastRows::start(std::int64_t row) const noexcept {
  Start s{0, 0};
  for (int i = outer_rank_ - 1; i >= 0; --i) {
    const Axis& axis = outer_[static_cast<std::size_t>(i)];
    s.a += row % axis.extent * axis.a_stride;
    s.b += row % axis.extent * axis.b_stride;
    row /= axis.extent;
  }
  return s;
}

}  // namespace slide::ops
