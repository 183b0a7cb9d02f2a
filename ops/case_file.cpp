#include "ops/case_file.h"

#include <array>
#include <cmath>

#include "ops/attention/attention.h"
#include "ops/attention/contextual_attention.h"
#include "ops/case_attributes.h"
#include "ops/conv2d/conv2d.h"
#include "ops/conv2d/gated_conv2d.h"
#include "ops/edges/median.h"
#include "ops/fill/fill.h"
#include "ops/fill/mirror.h"
#include "ops/guided/guided.h"
#include "ops/layering/distance_transform.h"
#include "ops/layering/layering.h"
#include "ops/matting/foreground.h"
#include "ops/normalise/normalise.h"
#include "ops/pointwise/pointwise.h"
#include "ops/pool/pool.h"
#include "ops/reduce/reduce.h"
#include "ops/resize/resize.h"
#include "ops/softmax/softmax.h"
#include "ops/tensor_shape/tensor_shape.h"
#include "runtime/error.h"

namespace slide::ops {
namespace {

/// No attribute that counts pixels or channels is larger, and no result has more elements: what a case file
/// asks for must not exhaust the memory.
constexpr std::int64_t kMost = std::int64_t{1} << 24;
constexpr std::int64_t kMostElements = std::int64_t{1} << 27;

using Build = Value (*)(CaseArguments&);
struct Entry {
  std::string_view name;
  Build build;
};

Conv2dParams conv_params(CaseArguments& c) {
  Conv2dParams p;
  p.stride = c.integers<2>("stride", 1, kMost, p.stride);
  p.padding = c.integers<4>("padding", 0, kMost, p.padding);
  p.dilation = c.integers<2>("dilation", 1, kMost, p.dilation);
  p.groups = c.integer("groups", 1, kMost, p.groups);
  return p;
}

Value build_conv2d(CaseArguments& c) {
  return conv2d(c.input("x"), c.input("weight"), c.optional_input("bias"), conv_params(c));
}

Value build_gated_conv2d(CaseArguments& c) {
  return gated_conv2d(c.input("x"), c.input("weight"), c.optional_input("bias"), conv_params(c));
}

Value build_contextual_attention(CaseArguments& c) {
  ContextualAttentionParams p;
  p.patch = c.integer("patch", 1, kMost, p.patch);
  p.rate = c.integer("rate", 1, kMost, p.rate);
  p.softmax_scale = c.number("softmax_scale", p.softmax_scale);
  p.fuse = c.integer("fuse", 0, kMost, p.fuse);
  return contextual_attention(c.input("foreground"), c.input("background"), c.input("mask"), p,
                              c.optional_input("fuse_weight"));
}

PoolParams pool_params(CaseArguments& c) {
  PoolParams p;
  p.kernel = c.integers<2>("kernel", 1, kMost);
  p.stride = c.integers<2>("stride", 1, kMost, std::array<std::int64_t, 2>{1, 1});
  p.padding = c.integers<4>("padding", 0, kMost, p.padding);
  p.ceil_mode = c.boolean("ceil_mode", false);
  return p;
}

Value build_max_pool2d(CaseArguments& c) { return max_pool2d(c.input("x"), pool_params(c)); }

Value build_avg_pool2d(CaseArguments& c) {
  PoolParams p = pool_params(c);
  p.count_include_pad = c.boolean("count_include_pad", false);
  return avg_pool2d(c.input("x"), p);
}

Value build_adaptive_avg_pool2d(CaseArguments& c) {
  const auto size = c.integers<2>("size", 1, kMost);
  return adaptive_avg_pool2d(c.input("x"), size[0], size[1]);
}

Value build_resize(CaseArguments& c) {
  ResizeParams p;
  p.mode = static_cast<ResizeMode>(c.choice("mode", {"nearest", "linear", "cubic"}));
  p.coordinates = static_cast<ResizeCoordinates>(
      c.choice("coordinates", {"half_pixel", "pytorch_half_pixel", "align_corners", "asymmetric"}));
  p.size = c.integers<2>("size", 1, kMost);
  p.scale = c.optional_pair("scale");
  p.nearest = static_cast<NearestRounding>(
      c.choice("nearest", {"floor", "ceil", "round_prefer_floor", "round_prefer_ceil"}, 0));
  p.cubic_a = c.number("cubic_a", p.cubic_a);
  return resize(c.input("x"), p);
}

Value build_upsample_nearest(CaseArguments& c) {
  return upsample_nearest(c.input("x"), c.integer("factor", 1, 1 << 12));
}

std::vector<int> axes(CaseArguments& c) {
  std::vector<int> result;
  for (const std::int64_t axis :
       c.integer_list("axes", -Shape::kMaxRank, Shape::kMaxRank - 1, Shape::kMaxRank))
    result.push_back(static_cast<int>(axis));
  return result;
}

int axis(CaseArguments& c) {
  return static_cast<int>(c.integer("axis", -Shape::kMaxRank, Shape::kMaxRank - 1));
}

Value build_batch_norm(CaseArguments& c) {
  return batch_norm(c.input("x"), c.input("weight"), c.input("bias"), c.input("running_mean"),
                    c.input("running_var"), c.number("eps", 1e-5));
}

Value build_group_norm(CaseArguments& c) {
  return group_norm(c.input("x"), c.integer("groups", 1, kMost), c.input("weight"), c.input("bias"),
                    c.number("eps", 1e-5));
}

Value build_attention(CaseArguments& c) {
  const std::int64_t heads = c.integer("heads", 1, kMost);
  return attention(c.input("query"), c.input("key"), c.input("value"), heads, c.number("scale"));
}

Value build_layer_norm(CaseArguments& c) {
  return layer_norm(c.input("x"), axis(c), c.input("weight"), c.input("bias"), c.number("eps", 1e-5));
}

Value build_permute(CaseArguments& c) { return permute(c.input("x"), axes(c)); }

Value build_pad(CaseArguments& c) {
  const auto mode = static_cast<PadMode>(c.choice("mode", {"constant", "edge", "reflect"}, 0));
  return pad(c.input("x"), c.integers<4>("padding", 0, kMost), mode, c.number("value", 0));
}

Value build_reshape(CaseArguments& c) {
  const std::vector<std::int64_t> extents = c.integer_list("shape", 0, kMost, Shape::kMaxRank);
  return reshape(c.input("x"), Shape(std::span<const std::int64_t>(extents)));
}

constexpr Entry kEntries[] = {
    {"conv2d", build_conv2d},
    {"gated_conv2d", build_gated_conv2d},
    {"attention", build_attention},
    {"contextual_attention", build_contextual_attention},
    {"max_pool2d", build_max_pool2d},
    {"avg_pool2d", build_avg_pool2d},
    {"global_avg_pool2d", [](CaseArguments& c) { return global_avg_pool2d(c.input("x")); }},
    {"adaptive_avg_pool2d", build_adaptive_avg_pool2d},
    {"resize", build_resize},
    {"upsample_nearest", build_upsample_nearest},
    {"relu", [](CaseArguments& c) { return relu(c.input("x")); }},
    {"relu6", [](CaseArguments& c) { return relu6(c.input("x")); }},
    {"leaky_relu", [](CaseArguments& c) { return leaky_relu(c.input("x"), c.number("slope")); }},
    {"elu", [](CaseArguments& c) { return elu(c.input("x"), c.number("alpha", 1)); }},
    {"sigmoid", [](CaseArguments& c) { return sigmoid(c.input("x")); }},
    {"tanh", [](CaseArguments& c) { return tanh(c.input("x")); }},
    {"exp", [](CaseArguments& c) { return exp(c.input("x")); }},
    {"sqrt", [](CaseArguments& c) { return sqrt(c.input("x")); }},
    {"abs", [](CaseArguments& c) { return abs(c.input("x")); }},
    {"clip",
     [](CaseArguments& c) {
       return clip(c.input("x"), c.number("min", -INFINITY), c.number("max", INFINITY));
     }},
    {"affine", [](CaseArguments& c) { return affine(c.input("x"), c.number("scale"), c.number("shift")); }},
    {"silu", [](CaseArguments& c) { return silu(c.input("x")); }},
    {"gelu", [](CaseArguments& c) { return gelu(c.input("x")); }},
    {"greater", [](CaseArguments& c) { return greater(c.input("x"), c.number("threshold")); }},
    {"add", [](CaseArguments& c) { return add(c.input("x"), c.input("other")); }},
    {"sub", [](CaseArguments& c) { return sub(c.input("x"), c.input("other")); }},
    {"mul", [](CaseArguments& c) { return mul(c.input("x"), c.input("other")); }},
    {"div", [](CaseArguments& c) { return div(c.input("x"), c.input("other")); }},
    {"minimum", [](CaseArguments& c) { return minimum(c.input("x"), c.input("other")); }},
    {"maximum", [](CaseArguments& c) { return maximum(c.input("x"), c.input("other")); }},
    {"concat", [](CaseArguments& c) { return concat(c.numbered_inputs(), axis(c)); }},
    {"slice",
     [](CaseArguments& c) {
       return slice(c.input("x"), axis(c), c.integer("start", 0, kMost), c.integer("end", 1, kMost));
     }},
    {"pad", build_pad},
    {"reshape", build_reshape},
    {"permute", build_permute},
    {"softmax", [](CaseArguments& c) { return softmax(c.input("x"), axis(c)); }},
    {"reduce_min", [](CaseArguments& c) { return reduce_min(c.input("x"), axes(c)); }},
    {"reduce_max", [](CaseArguments& c) { return reduce_max(c.input("x"), axes(c)); }},
    {"reduce_mean", [](CaseArguments& c) { return reduce_mean(c.input("x"), axes(c)); }},
    {"batch_norm", build_batch_norm},
    {"group_norm", build_group_norm},
    {"layer_norm", build_layer_norm},
    {"weight_standardise",
     [](CaseArguments& c) { return weight_standardise(c.input("weight"), c.number("eps", 1e-5)); }},
    {"min_max_normalise", [](CaseArguments& c) { return min_max_normalise(c.input("x")); }},
    {"gaussian_blur", [](CaseArguments& c) { return gaussian_blur(c.input("x"), c.number("sigma")); }},
    {"mirror_known", [](CaseArguments& c) { return mirror_known(c.input("x"), c.input("weight")); }},
    {"push_pull_fill",
     [](CaseArguments& c) {
       const auto sweeps = static_cast<int>(c.integer("sweeps", 0, 1 << 12));
       return push_pull_fill(c.input("x"), c.input("weight"), sweeps);
     }},
    {"guided_coefficients",
     [](CaseArguments& c) {
       const std::int64_t radius = c.integer("radius", 0, INT64_MAX);
       return guided_coefficients(c.input("guide"), c.input("x"), radius, c.number("eps"));
     }},
    {"foreground_colours",
     [](CaseArguments& c) { return foreground_colours(c.input("image"), c.input("alpha")); }},
    {"median", [](CaseArguments& c) { return median(c.input("x"), c.integer("radius", 0, 1024)); }},
    {"sobel", [](CaseArguments& c) { return sobel(c.input("x")); }},
    {"cone_dilation",
     [](CaseArguments& c) {
       return cone_dilation(c.input("x"), c.number("rho"), c.integer("radius", 0, INT64_MAX));
     }},
    {"distance_transform", [](CaseArguments& c) { return distance_transform(c.input("x")); }},
};

}  // namespace

Value build_case(std::string_view op, const std::string& attributes_json,
                 const std::vector<std::pair<std::string, Value>>& inputs) {
  for (const Entry& entry : kEntries) {
    if (entry.name != op) continue;
    CaseArguments arguments(op, attributes_json, inputs);
    try {
      const Value value = entry.build(arguments);
      arguments.done();
      if (value.shape().count() > kMostElements)
        throw Error(ErrorKind::kBadInput, "the case of operator " + std::string(op) +
                                              " asks for a result of shape " + value.shape().text());
      return value;
    } catch (const Error& e) {
      if (e.kind() != ErrorKind::kInternal) throw;
      // Shapes that do not fit are the caller's defect everywhere else; here they came from the file.
      throw Error(ErrorKind::kBadInput, e.what());
    }
  }
  throw Error(ErrorKind::kBadInput, "there is no operator " + std::string(op.substr(0, 40)),
              "docs/operators.md lists all");
}

std::vector<std::string> case_operators() {
  std::vector<std::string> names;
  for (const Entry& entry : kEntries) names.emplace_back(entry.name);
  return names;
}

}  // namespace slide::ops
