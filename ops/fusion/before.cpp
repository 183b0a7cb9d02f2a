#include <algorithm>
#include <array>
#include <functional>

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

/// Convolution `reader` of node i with the rewrite done; null if that cannot be.
std::shared_ptr<const Conv2dOp> rewritten(const Draft& draft, int reader, int i, const Rewrite& rewrite) {
  const auto* conv = draft.as<Conv2dOp>(reader);
  std::vector<int> inputs = draft.node(reader).inputs;
  if (conv == nullptr || inputs[0] != i || std::ranges::count(inputs, i) != 1) return nullptr;
  ConvForm form{conv->params(), conv->fusion()};
  if (!rewrite(form, draft.node(inputs[1]).shape)) return nullptr;
  auto op = std::make_shared<const Conv2dOp>(form.params, form.fusion);
  inputs[0] = draft.node(i).inputs[0];
  return draft.may_become(reader, *op, inputs) ? op : nullptr;
}

}  // namespace

void fuse_before(Draft& draft, int i) {
  if (!draft.live(i) || draft.result(i) || draft.constant(i)) return;
  const Rewrite rewrite = rewrite_for(draft, i);
  if (!rewrite) return;
  const std::vector<int> readers = draft.readers(i);
  std::vector<std::shared_ptr<const Conv2dOp>> convolutions;
  for (const int reader : readers) {
    convolutions.push_back(rewritten(draft, reader, i, rewrite));
    if (convolutions.back() == nullptr) return;
  }
  const int x = draft.node(i).inputs[0];
  for (std::size_t k = 0; k < readers.size(); ++k) {
    std::vector<int> inputs = draft.node(readers[k]).inputs;
    inputs[0] = x;
    draft.replace(readers[k], convolutions[k], std::move(inputs));
  }
}

}  // namespace slide::ops
