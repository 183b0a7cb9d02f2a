#include "ops/case_of.h"

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "ops/attention/attention_op.h"
#include "ops/attention/contextual_attention_op.h"
#include "ops/conv2d/conv2d_op.h"
#include "ops/edges/median_op.h"
#include "ops/fill/fill_op.h"
#include "ops/fill/mirror_op.h"
#include "ops/guided/guided_op.h"
#include "ops/layering/distance_transform.h"
#include "ops/layering/layering_ops.h"
#include "ops/matting/foreground_op.h"
#include "ops/normalise/normalise_ops.h"
#include "ops/pointwise/binary_op.h"
#include "ops/pointwise/unary_op.h"
#include "ops/pool/pool_op.h"
#include "ops/reduce/reduce_op.h"
#include "ops/resize/resize_op.h"
#include "ops/softmax/softmax_op.h"
#include "ops/tensor_shape/tensor_shape_ops.h"
#include "runtime/error.h"

namespace slide::ops {
namespace {

using Json = nlohmann::ordered_json;

// One function for each operator class, the inverse of what build_case() reads. Operators without attributes
// need none.

Json attributes_of(const Conv2dParams& p) {
  return {{"stride", p.stride}, {"padding", p.padding}, {"dilation", p.dilation}, {"groups", p.groups}};
}

Json attributes_of(const UnaryOp& op) {
  switch (op.kind()) {
    case UnaryKind::kLeakyRelu:
      return {{"slope", op.a()}};
    case UnaryKind::kElu:
      return {{"alpha", op.a()}};
    case UnaryKind::kClip: {
      Json json = Json::object();  // JSON has no infinities: a bound that is none is left out
      if (std::isfinite(op.a())) json["min"] = op.a();
      if (std::isfinite(op.b())) json["max"] = op.b();
      return json;
    }
    case UnaryKind::kAffine:
      return {{"scale", op.a()}, {"shift", op.b()}};
    case UnaryKind::kGreater:
      return {{"threshold", op.a()}};
    default:
      return Json::object();
  }
}

Json attributes_of(const PoolOp& op) {
  const PoolParams& p = op.params();
  Json json{{"kernel", p.kernel}, {"stride", p.stride}, {"padding", p.padding}, {"ceil_mode", p.ceil_mode}};
  if (op.kind() == PoolKind::kAverage) json["count_include_pad"] = p.count_include_pad;
  return json;
}

Json attributes_of(const ResizeOp& op) {
  constexpr std::array kModes = {"nearest", "linear", "cubic"};
  constexpr std::array kCoordinates = {"half_pixel", "pytorch_half_pixel", "align_corners", "asymmetric"};
  constexpr std::array kNearest = {"floor", "ceil", "round_prefer_floor", "round_prefer_ceil"};
  const ResizeParams& p = op.params();
  Json json{{"mode", kModes[static_cast<std::size_t>(p.mode)]},
            {"coordinates", kCoordinates[static_cast<std::size_t>(p.coordinates)]},
            {"size", p.size},
            {"nearest", kNearest[static_cast<std::size_t>(p.nearest)]},
            {"cubic_a", p.cubic_a}};
  if (p.scale) json["scale"] = *p.scale;
  return json;
}

Json attributes_of(const PadOp& op) {
  constexpr std::array kModes = {"constant", "edge", "reflect"};
  return {{"padding", op.padding()},
          {"mode", kModes[static_cast<std::size_t>(op.mode())]},
          {"value", op.value()}};
}

Json attributes_of(const ContextualAttentionOp& op) {
  const ContextualAttentionParams& p = op.params();
  return {{"patch", p.patch}, {"rate", p.rate}, {"softmax_scale", p.softmax_scale}, {"fuse", p.fuse}};
}

template <typename T>
const T* as(const Op& op) {
  return dynamic_cast<const T*>(&op);
}

Json attributes_of(const Op& op, const Shape& output) {
  if (const auto* o = as<Conv2dOp>(op)) return attributes_of(o->params());
  if (const auto* o = as<UnaryOp>(op)) return attributes_of(*o);
  if (const auto* o = as<PoolOp>(op)) return attributes_of(*o);
  if (const auto* o = as<ResizeOp>(op)) return attributes_of(*o);
  if (const auto* o = as<PadOp>(op)) return attributes_of(*o);
  if (const auto* o = as<ReduceOp>(op)) return {{"axes", o->axes()}};
  if (const auto* o = as<ContextualAttentionOp>(op)) return attributes_of(*o);
  if (const auto* o = as<AdaptiveAvgPoolOp>(op)) return {{"size", {o->height(), o->width()}}};
  if (const auto* o = as<ConcatOp>(op)) return {{"axis", o->axis()}};
  if (const auto* o = as<SoftmaxOp>(op)) return {{"axis", o->axis()}};
  if (const auto* o = as<SliceOp>(op)) return {{"axis", o->axis()}, {"start", o->start()}, {"end", o->end()}};
  if (const auto* o = as<BatchNormOp>(op)) return {{"eps", o->eps()}};
  if (const auto* o = as<GroupNormOp>(op)) return {{"groups", o->groups()}, {"eps", o->eps()}};
  if (const auto* o = as<LayerNormOp>(op)) return {{"axis", o->axis()}, {"eps", o->eps()}};
  if (const auto* o = as<AttentionOp>(op)) return {{"heads", o->heads()}, {"scale", o->scale()}};
  if (const auto* o = as<PermuteOp>(op)) return {{"axes", o->axes()}};
  if (const auto* o = as<WeightStandardiseOp>(op)) return {{"eps", o->eps()}};
  if (const auto* o = as<GaussianBlurOp>(op)) return {{"sigma", o->sigma()}};
  if (const auto* o = as<ConeDilationOp>(op)) return {{"rho", o->rho()}, {"radius", o->radius()}};
  if (const auto* o = as<MedianOp>(op)) return {{"radius", o->radius()}};
  if (const auto* o = as<PushPullFillOp>(op)) return {{"sweeps", o->sweeps()}};
  if (const auto* o = as<GuidedCoefficientsOp>(op)) return {{"radius", o->radius()}, {"eps", o->eps()}};
  if (as<ReshapeOp>(op) != nullptr) {
    const auto extents = output.extents();
    return {{"shape", std::vector<std::int64_t>(extents.begin(), extents.end())}};
  }
  if (as<BinaryOp>(op) != nullptr || as<MinMaxNormaliseOp>(op) != nullptr || as<SobelOp>(op) != nullptr ||
      as<DistanceTransformOp>(op) != nullptr || as<MirrorKnownOp>(op) != nullptr ||
      as<ForegroundColoursOp>(op) != nullptr)
    return Json::object();
  throw Error(ErrorKind::kInternal, "the operator " + std::string(op.type()) + " has no case form");
}

std::vector<std::string> input_names(const Op& op, std::size_t count) {
  if (as<ConcatOp>(op) != nullptr) {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < count; ++i) names.push_back("x" + std::to_string(i));
    return names;
  }
  if (as<Conv2dOp>(op) != nullptr || as<GroupNormOp>(op) != nullptr || as<LayerNormOp>(op) != nullptr)
    return {"x", "weight", "bias"};
  if (as<BatchNormOp>(op) != nullptr) return {"x", "weight", "bias", "running_mean", "running_var"};
  if (as<AttentionOp>(op) != nullptr) return {"query", "key", "value"};
  if (as<PushPullFillOp>(op) != nullptr || as<MirrorKnownOp>(op) != nullptr) return {"x", "weight"};
  if (as<GuidedCoefficientsOp>(op) != nullptr) return {"guide", "x"};
  if (as<ForegroundColoursOp>(op) != nullptr) return {"image", "alpha"};
  if (as<WeightStandardiseOp>(op) != nullptr) return {"weight"};
  if (as<ContextualAttentionOp>(op) != nullptr) return {"foreground", "background", "mask", "fuse_weight"};
  return {"x", "other"};
}

}  // namespace

OperatorCase case_of(const Op& op, std::span<const Tensor> inputs, const Tensor& expected) {
  OperatorCase result;
  result.op = op.type();
  result.attributes = attributes_of(op, expected.shape()).dump();
  const std::vector<std::string> names = input_names(op, inputs.size());
  for (std::size_t i = 0; i < inputs.size(); ++i) result.inputs.emplace_back(names.at(i), inputs[i]);
  result.expected = expected;
  return result;
}

}  // namespace slide::ops
