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

/// A node that convolutions may take in.
struct Taken {
  Rewrite rewrite;
  int x;                      // what they read instead of it
  std::optional<int> joined;  // ... and behind their other inputs, which must have a bias
};

std::optional<Taken> taken_resize(const Draft& draft, int i) {
  const auto* resize = draft.as<ResizeOp>(i);
  if (resize == nullptr || resize->fusion().residual) return std::nullopt;
  const int x = draft.node(i).inputs[0];
  const Upsampling upsampling = upsampling_of(*resize, draft.node(x).shape);
  if (upsampling == Upsampling::kNone) return std::nullopt;
  return Taken{
      [upsampling](ConvForm& form, const Shape& weight) { return take_upsampling(form, weight, upsampling); },
      x, std::nullopt};
}

/// A concat of channels: first those of a bilinear enlargement by 2 that nothing else reads, then another
/// tensor's.
std::optional<Taken> taken_concat(const Draft& draft, int i) {
  const auto* concat = draft.as<ConcatOp>(i);
  const std::vector<int>& parts = draft.node(i).inputs;
  if (concat == nullptr || concat->axis() != 1 || parts.size() != 2 || !draft.read_once(parts[0]))
    return std::nullopt;
  std::optional<Taken> taken = taken_resize(draft, parts[0]);
  if (!taken) return std::nullopt;
  taken->joined = parts[1];
  const std::int64_t channels = draft.node(parts[1]).shape[1];
  taken->rewrite = [enlarge = std::move(taken->rewrite), channels](ConvForm& form, const Shape& weight) {
    form.fusion.joined = channels;
    return enlarge(form, weight) && form.fusion.upsample_input == Upsampling::kBilinear;
  };
  return taken;
}

/// How convolutions take node i in, if they can.
std::optional<Taken> taken(const Draft& draft, int i) {
  if (const auto* unary = draft.as<UnaryOp>(i); unary != nullptr && unary->kind() == UnaryKind::kRelu)
    return Taken{take_relu, draft.node(i).inputs[0], std::nullopt};
  if (const auto* pad = draft.as<PadOp>(i);
      pad != nullptr && pad->mode() == PadMode::kConstant && pad->value() == 0)
    return Taken{
        [padding = pad->padding()](ConvForm& form, const Shape&) { return take_padding(form, padding); },
        draft.node(i).inputs[0], std::nullopt};
  if (std::optional<Taken> resize = taken_resize(draft, i)) return resize;
  return taken_concat(draft, i);
}

/// What a convolution becomes.
struct Rewritten {
  std::shared_ptr<const Conv2dOp> op;  // null if that cannot be
  std::vector<int> inputs;
};

/// Convolution `reader`, of nothing but its image i, with i taken in.
Rewritten rewritten(const Draft& draft, int reader, int i, const Taken& taken) {
  const auto* conv = draft.as<Conv2dOp>(reader);
  std::vector<int> inputs = draft.node(reader).inputs;
  if (conv == nullptr || inputs[0] != i || std::ranges::count(inputs, i) != 1) return {};
  if (taken.joined && inputs.size() < 3) return {};  // there is no bias
  ConvForm form{conv->params(), conv->fusion()};
  if (!taken.rewrite(form, draft.node(inputs[1]).shape)) return {};
  auto op = std::make_shared<const Conv2dOp>(form.params, form.fusion);
  inputs[0] = taken.x;
  if (taken.joined) inputs.push_back(*taken.joined);
  return draft.may_become(reader, *op, inputs) ? Rewritten{op, inputs} : Rewritten{};
}

}  // namespace

/// All readers take it in or none.
void fuse_before(Draft& draft, int i) {
  if (!draft.live(i) || draft.result(i) || draft.constant(i)) return;
  const std::optional<Taken> node = taken(draft, i);
  if (!node) return;
  const std::vector<int> readers = draft.readers(i);
  std::vector<Rewritten> convolutions;
  convolutions.reserve(readers.size());
  for (const int reader : readers) {
    convolutions.push_back(rewritten(draft, reader, i, *node));
    if (convolutions.back().op == nullptr) return;
  }
  for (std::size_t k = 0; k < readers.size(); ++k)
    draft.replace(readers[k], convolutions[k].op, std::move(convolutions[k].inputs));
}

}  // namespace slide::ops
