#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "ops/conv2d/conv2d_op.h"
#include "ops/fusion/rewrites.h"
#include "ops/normalise/normalise_ops.h"
#include "ops/pointwise/binary_op.h"
#include "ops/pointwise/unary_op.h"
#include "ops/pointwise/unary_row.h"
#include "ops/resize/resize_op.h"
#include "ops/tensor_shape/tensor_shape_ops.h"

namespace slide::ops {
namespace {

/// What a convolution's result is multiplied with and what is then added, per channel: nodes of shape C.
struct ChannelMap {
  int scale, shift;
};

/// The convolution that makes node i, if only node i's one reader reads it and it has neither gate nor
/// activation, behind which nothing more fits.
const Conv2dOp* open_conv(const Draft& draft, int i) {
  const auto* conv = draft.as<Conv2dOp>(i);
  const bool open =
      conv != nullptr && draft.read_once(i) && !conv->fusion().gate && conv->fusion().activation == nullptr;
  return open ? conv : nullptr;
}

/// Whether the convolution is w ∗ x + b with constant w and b, and no more.
bool foldable(const Draft& draft, int i, const Conv2dOp& conv) {
  const std::vector<int>& inputs = draft.node(i).inputs;
  return !conv.fusion().residual &&
         std::all_of(inputs.begin() + 1, inputs.end(), [&](int j) { return draft.constant(j); });
}

std::shared_ptr<const Op> with_fusion(const GroupNormOp& norm, const GroupNormFusion& fusion) {
  return std::make_shared<GroupNormOp>(norm.groups(), norm.eps(), fusion);
}

int add_unary(Draft& draft, int owner, UnaryKind kind, int x, double a = 0, double b = 0) {
  return draft.add(owner, std::make_shared<UnaryOp>(kind, a, b), {x});
}

int add_binary(Draft& draft, int owner, BinaryKind kind, int x, int other) {
  return draft.add(owner, std::make_shared<BinaryOp>(kind), {x, other});
}

/// Node i becomes the convolution scale · (w ∗ x + b) + shift, that is (scale·w) ∗ x + (scale·b + shift).
void fold(Draft& draft, int i, int conv, const ChannelMap& map) {
  const Conv2dOp& op = *draft.as<Conv2dOp>(conv);
  std::vector<int> inputs = draft.node(conv).inputs;
  const std::int64_t channels = draft.node(map.scale).shape[0];
  const int filters = draft.add(i, std::make_shared<ReshapeOp>(Shape{channels, 1, 1, 1}), {map.scale});
  inputs[1] = add_binary(draft, i, BinaryKind::kMul, inputs[1], filters);
  if (inputs.size() < 3) {
    inputs.push_back(map.shift);
  } else {
    const int scaled = add_binary(draft, i, BinaryKind::kMul, inputs[2], map.scale);
    inputs[2] = add_binary(draft, i, BinaryKind::kAdd, scaled, map.shift);
  }
  draft.replace(i, std::make_shared<Conv2dOp>(op.params(), op.fusion()), inputs);
}

/// weight / sqrt(var + eps), and bias - mean · scale.
ChannelMap map_of(Draft& draft, int i, const BatchNormOp& norm) {
  const std::vector<int> inputs = draft.node(i).inputs;
  const int variance = add_unary(draft, i, UnaryKind::kAffine, inputs[4], 1, norm.eps());
  const int deviation = add_unary(draft, i, UnaryKind::kSqrt, variance);
  const int scale = add_binary(draft, i, BinaryKind::kDiv, inputs[1], deviation);
  const int mean = add_binary(draft, i, BinaryKind::kMul, inputs[3], scale);
  return {scale, add_binary(draft, i, BinaryKind::kSub, inputs[2], mean)};
}

/// a and b in every channel.
ChannelMap map_of(Draft& draft, int i, const UnaryOp& affine) {
  const Shape channels{draft.node(i).shape[1]};
  const int scale = draft.add_constant(i, channels, affine.a());
  return {scale, draft.add_constant(i, channels, affine.b())};
}

/// Whether batch norm or affine() i was folded into the convolution before it.
bool fold_norm(Draft& draft, int i) {
  const auto* norm = draft.as<BatchNormOp>(i);
  const auto* unary = draft.as<UnaryOp>(i);
  const bool affine = unary != nullptr && unary->kind() == UnaryKind::kAffine;
  if (norm == nullptr && !affine) return false;
  const std::vector<int> inputs = draft.node(i).inputs;
  const Conv2dOp* conv = open_conv(draft, inputs[0]);
  if (conv == nullptr || !foldable(draft, inputs[0], *conv)) return false;
  if (!std::all_of(inputs.begin() + 1, inputs.end(), [&](int j) { return draft.constant(j); })) return false;
  fold(draft, i, inputs[0], norm != nullptr ? map_of(draft, i, *norm) : map_of(draft, i, *unary));
  return true;
}

/// Whether a residual fits behind node i: a convolution, resize or group norm that nothing else reads, with
/// neither gate nor residual, of which convolutions may have an activation.
bool takes_residual(const Draft& draft, int i) {
  if (!draft.read_once(i)) return false;
  if (const auto* resize = draft.as<ResizeOp>(i)) return !resize->fusion().residual;
  if (const auto* conv = draft.as<Conv2dOp>(i)) return !conv->fusion().gate && !conv->fusion().residual;
  const auto* norm = draft.as<GroupNormOp>(i);
  return norm != nullptr && !norm->fusion().residual && norm->fusion().activation == nullptr;
}

/// Node i, a convolution, resize or group norm, with a residual.
std::shared_ptr<const Op> with_residual(const Draft& draft, int i) {
  if (const auto* resize = draft.as<ResizeOp>(i))
    return std::make_shared<ResizeOp>(resize->params(), ResizeFusion{.residual = true});
  if (const auto* norm = draft.as<GroupNormOp>(i)) return with_fusion(*norm, {.residual = true});
  const auto& conv = *draft.as<Conv2dOp>(i);
  Conv2dFusion fusion = conv.fusion();
  fusion.residual = true;
  fusion.residual_last = fusion.activation != nullptr;
  return std::make_shared<Conv2dOp>(conv.params(), fusion);
}

/// add() i becomes the later of the two convolutions, resizes or group norms before it, with the other
/// summand as its residual. A resize only if no other can: they have activations behind.
void fuse_residual(Draft& draft, int i) {
  const auto* add = draft.as<BinaryOp>(i);
  if (add == nullptr || add->kind() != BinaryKind::kAdd) return;
  const std::vector<int> summands = draft.node(i).inputs;
  if (draft.node(summands[0]).shape != draft.node(summands[1]).shape) return;
  const auto [first, last] = std::minmax({summands[0], summands[1]});
  std::array<std::pair<int, int>, 2> candidates{{{last, first}, {first, last}}};
  if (draft.as<ResizeOp>(last) != nullptr && draft.as<ResizeOp>(first) == nullptr)
    std::swap(candidates[0], candidates[1]);
  for (const auto& [before, other] : candidates) {
    if (!takes_residual(draft, before)) continue;
    std::vector<int> inputs = draft.node(before).inputs;
    if (draft.as<Conv2dOp>(before) != nullptr && inputs.size() < 3)
      inputs.push_back(draft.add_constant(i, {draft.node(i).shape[1]}, 0));
    inputs.push_back(other);
    std::shared_ptr<const Op> fused = with_residual(draft, before);
    if (draft.may_become(i, *fused, inputs)) return draft.replace(i, std::move(fused), std::move(inputs));
  }
}

void fuse_activation(Draft& draft, int i) {
  const auto* activation = draft.as<UnaryOp>(i);
  if (activation == nullptr || !activation_slope(*activation)) return;
  const int before = draft.node(i).inputs[0];
  const auto function = std::static_pointer_cast<const UnaryOp>(draft.node(i).op);
  const std::vector<int> inputs = draft.node(before).inputs;
  std::shared_ptr<const Op> fused;
  if (const Conv2dOp* conv = open_conv(draft, before)) {
    Conv2dFusion fusion = conv->fusion();
    fusion.activation = function;
    fused = std::make_shared<Conv2dOp>(conv->params(), fusion);
  } else if (const auto* norm = draft.as<GroupNormOp>(before);
             norm != nullptr && draft.read_once(before) && norm->fusion().activation == nullptr) {
    fused = with_fusion(*norm, {.residual = norm->fusion().residual, .activation = function});
  } else {
    return;
  }
  if (draft.may_become(i, *fused, inputs)) draft.replace(i, std::move(fused), inputs);
}

}  // namespace

void fuse_behind(Draft& draft, int i) {
  if (draft.constant(i) || fold_norm(draft, i)) return;
  fuse_residual(draft, i);
  fuse_activation(draft, i);
}

}  // namespace slide::ops
