#include <algorithm>
#include <array>
#include <functional>
#include <optional>

#include "ops/conv2d/conv2d_op.h"
#include "ops/fusion/rewrites.h"
#include "ops/pointwise/unary_op.h"
#include "ops/resize/resize_op.h"
#include "ops/tensor_shape/tensor_shape_ops.h"

namespace slide::ops {
namespace {

/// What a convolution computes, without its tensors.
struct ConvForm {
  Conv2dParams params;
  Conv2dFusion fusion;
};

/// Takes something into the form and says whether it could.
using Rewrite = std::function<bool(ConvForm&, const Shape& weight)>;

bool take_relu(ConvForm& form, const Shape& /*weight*/) {
  form.fusion.relu_input = true;
  return form.fusion.upsample_input != Upsampling::kBilinear;
}

bool take_upsampling(ConvForm& form, const Shape& weight, Upsampling upsampling) {
  const Conv2dParams wanted = Conv2dParams::same(3);
  const bool fits = weight[2] == 3 && weight[3] == 3 && form.params.stride == wanted.stride &&
                    form.params.dilation == wanted.dilation && form.params.groups == 1 &&
                    form.params.padding == wanted.padding && !form.fusion.upsamples();
  form.fusion.upsample_input = upsampling;
  return fits && !(form.fusion.relu_input && upsampling == Upsampling::kBilinear);
}

/// Zeros around an upsampled tensor are no zeros around the one before.
bool take_padding(ConvForm& form, const std::array<std::int64_t, 4>& padding) {
  for (std::size_t side = 0; side < 4; ++side) form.params.padding[side] += padding[side];
  return !form.fusion.upsamples();
}

/// How an axis is enlarged, if by 2.
Upsampling upsampling_of(const ResizeAxis& axis, std::int64_t extent) {
  const auto size = static_cast<std::size_t>(2 * extent), taps = static_cast<std::size_t>(axis.taps);
  if (taps > 2 || axis.index.size() != size * taps) return Upsampling::kNone;
  for (std::size_t k = 0; k < size; ++k) {
    const auto at = static_cast<std::int64_t>(k / 2);
    const std::int64_t before = k % 2 == 0 ? at - 1 : at;
    const std::int64_t* index = &axis.index[k * taps];
    const double* weight = &axis.weight[k * taps];
    const bool same = taps == 1 ? index[0] == at
                                : index[0] == std::max<std::int64_t>(before, 0) &&
                                      index[1] == std::min(before + 1, extent - 1) &&
                                      weight[0] == (k % 2 == 0 ? 0.25 : 0.75) && weight[1] == 1 - weight[0];
    if (!same) return Upsampling::kNone;
  }
  return taps == 1 ? Upsampling::kNearest : Upsampling::kBilinear;
}

Upsampling upsampling_of(const ResizeOp& resize, const Shape& x) {
  const Upsampling rows = upsampling_of(resize.axis(0, x[2]), x[2]);
  return rows == upsampling_of(resize.axis(1, x[3]), x[3]) ? rows : Upsampling::kNone;
}

/// How a convolution takes node i in; empty if none does.
Rewrite rewrite_for(const Draft& draft, int i) {
  if (const auto* unary = draft.as<UnaryOp>(i); unary != nullptr && unary->kind() == UnaryKind::kRelu)
    return take_relu;
  if (const auto* pad = draft.as<PadOp>(i);
      pad != nullptr && pad->mode() == PadMode::kConstant && pad->value() == 0)
    return [padding = pad->padding()](ConvForm& form, const Shape&) { return take_padding(form, padding); };
  if (const auto* resize = draft.as<ResizeOp>(i); resize != nullptr && !resize->fusion().residual) {
    const Upsampling upsampling = upsampling_of(*resize, draft.node(draft.node(i).inputs[0]).shape);
    if (upsampling != Upsampling::kNone)
      return [upsampling](ConvForm& form, const Shape& weight) {
        return take_upsampling(form, weight, upsampling);
      };
  }
  return {};
}

/// What a convolution becomes.
struct Rewritten {
  std::shared_ptr<const Conv2dOp> op;  // null if that cannot be
  std::vector<int> inputs;
};

/// Convolution `reader`, of nothing but its image i, with the rewrite done, made of x and perhaps of a tensor
/// behind the other inputs.
Rewritten rewritten(const Draft& draft, int reader, int i, const Rewrite& rewrite, int x,
                    std::optional<int> joined = std::nullopt) {
  const auto* conv = draft.as<Conv2dOp>(reader);
  std::vector<int> inputs = draft.node(reader).inputs;
  if (conv == nullptr || inputs[0] != i || std::ranges::count(inputs, i) != 1) return {};
  if (joined && inputs.size() < 3) return {};  // there is no bias
  ConvForm form{conv->params(), conv->fusion()};
  if (!rewrite(form, draft.node(inputs[1]).shape)) return {};
  auto op = std::make_shared<const Conv2dOp>(form.params, form.fusion);
  inputs[0] = x;
  if (joined) inputs.push_back(*joined);
  return draft.may_become(reader, *op, inputs) ? Rewritten{op, inputs} : Rewritten{};
}

/// Rewrites all readers of node i or none.
void rewrite_readers(Draft& draft, int i, const Rewrite& rewrite, int x,
                     std::optional<int> joined = std::nullopt) {
  const std::vector<int> readers = draft.readers(i);
  std::vector<Rewritten> convolutions;
  convolutions.reserve(readers.size());
  for (const int reader : readers) {
    convolutions.push_back(rewritten(draft, reader, i, rewrite, x, joined));
    if (convolutions.back().op == nullptr) return;
  }
  for (std::size_t k = 0; k < readers.size(); ++k)
    draft.replace(readers[k], convolutions[k].op, std::move(convolutions[k].inputs));
}

/// Whether node i is a concat of channels: first those of a bilinear enlargement by 2 that nothing else
/// reads, then another tensor's.
bool joins_enlarged(const Draft& draft, int i) {
  const auto* concat = draft.as<ConcatOp>(i);
  const std::vector<int>& parts = draft.node(i).inputs;
  if (concat == nullptr || concat->axis() != 1 || parts.size() != 2 || !draft.read_once(parts[0]))
    return false;
  const auto* resize = draft.as<ResizeOp>(parts[0]);
  return resize != nullptr && !resize->fusion().residual &&
         upsampling_of(*resize, draft.node(draft.node(parts[0]).inputs[0]).shape) == Upsampling::kBilinear;
}

}  // namespace

void fuse_joined(Draft& draft, int i) {
  if (!draft.live(i) || draft.result(i) || draft.constant(i) || !joins_enlarged(draft, i)) return;
  const std::vector<int> parts = draft.node(i).inputs;
  const std::int64_t channels = draft.node(parts[1]).shape[1];
  const Rewrite join = [channels](ConvForm& form, const Shape& weight) {
    form.fusion.joined = channels;
    return take_upsampling(form, weight, Upsampling::kBilinear);
  };
  rewrite_readers(draft, i, join, draft.node(parts[0]).inputs[0], parts[1]);
}

void fuse_before(Draft& draft, int i) {
  if (!draft.live(i) || draft.result(i) || draft.constant(i)) return;
  if (const Rewrite rewrite = rewrite_for(draft, i))
    rewrite_readers(draft, i, rewrite, draft.node(i).inputs[0]);
}

}  // namespace slide::ops
