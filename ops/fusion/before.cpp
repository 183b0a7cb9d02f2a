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
  return true;
}

bool take_upsampling(ConvForm& form, const Shape& weight) {
  const Conv2dParams wanted = Conv2dParams::same(3);
  const bool fits = weight[2] == 3 && weight[3] == 3 && form.params.stride == wanted.stride &&
                    form.params.dilation == wanted.dilation && form.params.groups == 1 &&
                    form.params.padding == wanted.padding && !form.fusion.upsample_input;
  form.fusion.upsample_input = true;
  return fits;
}

/// Zeros around an upsampled tensor are no zeros around the one before.
bool take_padding(ConvForm& form, const std::array<std::int64_t, 4>& padding) {
  for (std::size_t side = 0; side < 4; ++side) form.params.padding[side] += padding[side];
  return !form.fusion.upsample_input;
}

/// Whether output i of the axis is input floor(i / 2), to twice the extent.
bool doubles(const ResizeAxis& axis, std::int64_t extent) {
  if (axis.taps != 1 || axis.index.size() != static_cast<std::size_t>(2 * extent)) return false;
  for (std::size_t k = 0; k < axis.index.size(); ++k)
    if (axis.index[k] != static_cast<std::int64_t>(k / 2)) return false;
  return true;
}

/// How a convolution takes node i in; empty if none does.
Rewrite rewrite_for(const Draft& draft, int i) {
  if (const auto* unary = draft.as<UnaryOp>(i); unary != nullptr && unary->kind() == UnaryKind::kRelu)
    return take_relu;
  if (const auto* pad = draft.as<PadOp>(i);
      pad != nullptr && pad->mode() == PadMode::kConstant && pad->value() == 0)
    return [padding = pad->padding()](ConvForm& form, const Shape&) { return take_padding(form, padding); };
  if (const auto* resize = draft.as<ResizeOp>(i)) {
    const Shape& x = draft.node(draft.node(i).inputs[0]).shape;
    if (resize->params().mode == ResizeMode::kNearest && doubles(resize->axis(0, x[2]), x[2]) &&
        doubles(resize->axis(1, x[3]), x[3]))
      return take_upsampling;
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
