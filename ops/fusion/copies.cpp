#include <cstdint>

#include "ops/fusion/rewrites.h"
#include "ops/pointwise/unary_op.h"
#include "ops/resize/resize_op.h"
#include "ops/tensor_shape/tensor_shape_ops.h"

namespace slide::ops {
namespace {

/// Whether output i of the axis is input i.
bool copies(const ResizeAxis& axis, std::int64_t extent) {
  const auto taps = static_cast<std::size_t>(axis.taps);
  if (axis.index.size() != static_cast<std::size_t>(extent) * taps) return false;
  for (std::size_t k = 0; k < axis.index.size(); ++k) {
    const bool same = axis.index[k] == static_cast<std::int64_t>(k / taps);
    if (!same && axis.weight[k] != 0) return false;
  }
  return true;
}

bool is_copy(const Draft& draft, int i) {
  const Node& node = draft.node(i);
  if (const auto* unary = draft.as<UnaryOp>(i))
    return unary->kind() == UnaryKind::kAffine && unary->a() == 1 && unary->b() == 0;
  if (draft.as<ConcatOp>(i) != nullptr) return node.inputs.size() == 1;
  const Shape& input = draft.node(node.inputs.at(0)).shape;
  if (draft.as<SliceOp>(i) != nullptr || draft.as<ReshapeOp>(i) != nullptr) return input == node.shape;
  if (const auto* resize = draft.as<ResizeOp>(i))
    return input == node.shape && copies(resize->axis(0, input[2]), input[2]) &&
           copies(resize->axis(1, input[3]), input[3]);
  return false;
}

}  // namespace

void leave_out_copy(Draft& draft, int i) {
  const bool candidate = draft.node(i).kind == NodeKind::kOp && draft.live(i) && !draft.result(i);
  if (candidate && is_copy(draft, i)) draft.bypass(i, draft.node(i).inputs.at(0));
}

}  // namespace slide::ops
