#include "ops/attention/contextual_attention.h"

#include <memory>
#include <string>
#include <vector>

#include "ops/attention/contextual_attention_op.h"
#include "ops/common/op_support.h"

namespace slide::ops {
namespace {

void check_params(const ContextualAttentionParams& params) {
  require_at_least("attention's rate", params.rate, 1);
  require_at_least("attention's patch", params.patch, 1);
  require_at_least("attention's fuse", params.fuse, 1);
  if (params.patch % 2 == 0 || params.fuse % 2 == 0 || params.patch > 99 || params.fuse > 99)
    throw shape_error("attention's patch and fuse are odd numbers up to 99, not " +
                      std::to_string(params.patch) + " and " + std::to_string(params.fuse));
}

}  // namespace

AttentionGeometry attention_geometry(std::span<const Shape> inputs, const ContextualAttentionParams& params) {
  require_input_count("contextual_attention", inputs, 3, 4);
  check_params(params);
  const Shape& x = inputs[0];
  const Shape& mask = inputs[2];
  require_rank("foreground", x, 4);
  require_shape("background", inputs[1], x);
  require_rank("mask", mask, 4);
  if (inputs.size() == 4) require_shape("fuse weight", inputs[3], Shape{1, 1, params.fuse, params.fuse});
  if (x[0] != 1 || x.count() == 0 || x[2] % params.rate != 0 || x[3] % params.rate != 0)
    throw shape_error("attention needs features 1xCxHxW with sides that are multiples of " +
                      std::to_string(params.rate) + ", not " + x.text());
  if (mask[0] != 1 || mask[1] != 1 || mask.count() == 0 || mask[2] % x[2] != 0 || mask[3] % x[3] != 0)
    throw shape_error("a mask of shape " + mask.text() + " is no whole multiple of the features, " +
                      x.text());
  AttentionGeometry g{};
  g.channels = x[1];
  g.height = x[2];
  g.width = x[3];
  g.rate = params.rate;
  g.patch = params.patch;
  g.fuse = params.fuse;
  g.softmax_scale = params.softmax_scale;
  g.rows = g.height / g.rate;
  g.columns = g.width / g.rate;
  g.mask_step_y = mask[2] / g.rows;
  g.mask_step_x = mask[3] / g.columns;
  g.mask_width = mask[3];
  return g;
}

std::string ContextualAttentionOp::attributes() const {
  return "patch " + std::to_string(params_.patch) + " rate " + std::to_string(params_.rate) + " fuse " +
         std::to_string(params_.fuse);
}

Shape ContextualAttentionOp::infer(std::span<const Shape> inputs) const {
  static_cast<void>(attention_geometry(inputs, params_));
  return inputs[0];
}

double ContextualAttentionOp::macs(std::span<const Shape> inputs, const Shape& /*output*/) const {
  const AttentionGeometry g = attention_geometry(inputs, params_);
  const auto n = static_cast<double>(g.positions());
  const auto values_per_pair =
      static_cast<double>(g.channels * (g.patch * g.patch + 4 * g.rate * g.rate) + 2 * g.fuse * g.fuse);
  return n * n * values_per_pair;
}

Value contextual_attention(Value foreground, Value background, Value mask,
                           const ContextualAttentionParams& params, std::optional<Value> fuse_weight) {
  std::vector<Value> inputs{foreground, background, mask};
  if (fuse_weight) inputs.push_back(*fuse_weight);
  return foreground.graph().add(std::make_shared<ContextualAttentionOp>(params), inputs);
}

}  // namespace slide::ops
