#include "ops/conv2d/conv2d_op.h"
#include "ops/fusion/rewrites.h"
#include "ops/resize/resize_op.h"

namespace slide::ops {
namespace {

/// Whether the convolution maps each pixel by itself, and nothing follows but perhaps a residual.
bool maps_pixels(const Conv2dOp& conv, const Shape& weight) {
  const Conv2dParams& p = conv.params();
  const Conv2dFusion& fusion = conv.fusion();
  return weight[2] == 1 && weight[3] == 1 && p.stride == Conv2dParams{}.stride &&
         p.padding == Conv2dParams{}.padding && !fusion.gate && fusion.activation == nullptr &&
         !fusion.relu_input && !fusion.upsamples();
}

std::int64_t pixels(const Shape& shape) { return shape[2] * shape[3]; }

}  // namespace

void convolve_before_resize(Draft& draft, int i) {
  const auto* conv = draft.as<Conv2dOp>(i);
  if (conv == nullptr) return;
  std::vector<int> inputs = draft.node(i).inputs;
  const int enlarged = inputs[0];
  const auto* resize = draft.as<ResizeOp>(enlarged);
  if (resize == nullptr || resize->fusion().residual || !draft.read_once(enlarged)) return;
  const int x = draft.node(enlarged).inputs[0];
  if (pixels(draft.node(x).shape) >= pixels(draft.node(enlarged).shape)) return;
  if (!maps_pixels(*conv, draft.node(inputs[1]).shape)) return;
  const ResizeFusion fusion{.residual = conv->fusion().residual};
  std::vector<int> resized{-1};
  if (fusion.residual) {
    resized.push_back(inputs.back());
    inputs.pop_back();
  }
  inputs[0] = x;
  auto outer = std::make_shared<const ResizeOp>(resize->params(), fusion);
  resized[0] = draft.add(i, std::make_shared<const Conv2dOp>(conv->params()), inputs);
  draft.replace(i, std::move(outer), std::move(resized));
}

}  // namespace slide::ops
