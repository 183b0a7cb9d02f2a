#include "ops/generate/draft.h"

#include <algorithm>
#include <array>

#include "runtime/error.h"

namespace slide::ops {
namespace {

using Json = nlohmann::ordered_json;

/// One, or about a multiple of some vector's or tile's width, up to `most`.
std::int64_t extent(Random& r, std::int64_t most) {
  constexpr std::array<std::int64_t, 23> kEdges = {1,  2,  3,  4,  5,  6,  7,  8,  9,  12, 15, 16,
                                                   17, 24, 25, 31, 32, 33, 47, 48, 63, 64, 65};
  const auto end = std::upper_bound(kEdges.begin(), kEdges.end(), most);
  return kEdges[static_cast<std::size_t>(r.integer(0, end - kEdges.begin() - 1))];
}

Shape picture(Random& r, std::int64_t channels) {
  return {r.chance(0.25) ? 2 : 1, channels, extent(r, 25), extent(r, 65)};
}

/// Of any rank from 1 to 4.
Shape any_shape(Random& r) {
  switch (r.integer(1, 4)) {
    case 1:
      return {r.chance(0.5) ? extent(r, 65) : r.integer(66, 300)};
    case 2:
      return {extent(r, 17), extent(r, 65)};
    case 3:
      return {extent(r, 9), extent(r, 9), extent(r, 33)};
    default:
      return picture(r, extent(r, 9));
  }
}

// Convolutions.

struct Convolution {
  std::int64_t groups, channels, filters;  // channels and filters of one group
  std::array<std::int64_t, 2> kernel, stride, dilation, size;
  std::array<std::int64_t, 4> padding;
};

Convolution convolution(Random& r, bool gated) {
  Convolution c{};
  const std::int64_t side = r.pick<std::int64_t>({1, 1, 3, 3, 3, 5, 7});
  c.kernel = r.chance(0.1) ? std::array{r.integer(1, 4), r.integer(1, 4)} : std::array{side, side};
  const std::int64_t stride = r.chance(0.25) ? 2 : 1;
  c.stride = r.chance(0.1) ? std::array{r.integer(1, 3), r.integer(1, 3)} : std::array{stride, stride};
  const std::int64_t dilation = r.chance(0.2) ? r.pick<std::int64_t>({2, 3, 4}) : 1;
  c.dilation = {dilation, dilation};
  c.groups = r.chance(0.4) ? extent(r, 33) : 1;
  const bool depthwise = c.groups > 1 && r.chance(0.5);
  c.channels = depthwise ? 1 : extent(r, c.groups > 1 ? 4 : 65);
  c.filters = depthwise ? r.integer(1, 2) : extent(r, c.groups > 1 ? 4 : 65);
  if (gated && c.groups * c.filters % 2 != 0) ++c.filters;
  if (gated && c.groups * c.filters % 2 != 0) c.groups = 1;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const std::int64_t reach = c.dilation[axis] * (c.kernel[axis] - 1);
    const bool uneven = r.chance(0.2);
    c.padding[axis] = uneven ? r.integer(0, reach) : r.chance(0.8) ? reach / 2 : 0;
    c.padding[axis + 2] = uneven ? r.integer(0, reach) : c.padding[axis];
    c.size[axis] =
        std::max(extent(r, axis == 0 ? 25 : 65), reach + 1 - c.padding[axis] - c.padding[axis + 2]);
  }
  // So that nobody waits: at most some ten million products.
  const auto products = [&] {
    return c.groups * c.channels * c.filters * c.kernel[0] * c.kernel[1] * c.size[0] * c.size[1];
  };
  while (products() > 10'000'000 && c.channels > 1) c.channels /= 2;
  return c;
}

CallDraft convolution_draft(Random& r, bool gated) {
  const Convolution c = convolution(r, gated);
  CallDraft d;
  d.attributes = {
      {"stride", c.stride}, {"padding", c.padding}, {"dilation", c.dilation}, {"groups", c.groups}};
  d.inputs = {{"x", {r.chance(0.2) ? 2 : 1, c.groups * c.channels, c.size[0], c.size[1]}, Content::kSignal},
              {"weight", {c.groups * c.filters, c.channels, c.kernel[0], c.kernel[1]}, Content::kWeights}};
  if (r.chance(0.75)) d.inputs.push_back({"bias", {c.groups * c.filters}, Content::kParameter});
  return d;
}

// Attention.

CallDraft attention_draft(Random& r) {
  const std::int64_t heads = r.integer(1, 3);
  const std::int64_t n = r.integer(1, 2);
  const std::int64_t c = heads * extent(r, 17), v = heads * extent(r, 17);
  const std::int64_t h = extent(r, 5), w = extent(r, 17), key_h = extent(r, 9), key_w = extent(r, 33);
  CallDraft d;
  d.most_reach = 50;  // scores are products of two inputs, and no part of the result's scale where one wins
  d.attributes = {{"heads", heads}, {"scale", r.pick({0.125, 0.25, 1.0})}};
  d.inputs = {{"query", {n, c, h, w}, Content::kSignal},
              {"key", {n, c, key_h, key_w}, Content::kSignal},
              {"value", {n, v, key_h, key_w}, Content::kSignal}};
  return d;
}

CallDraft contextual_attention_draft(Random& r) {
  const std::int64_t rate = r.integer(1, 2);
  const Shape features{1, extent(r, 9), rate * r.integer(3, 6), rate * r.integer(3, 9)};
  const std::int64_t finer = r.pick<std::int64_t>({1, 2, 4});
  CallDraft d;
  d.bounded = true;
  d.attributes = {{"patch", 3}, {"rate", rate}, {"softmax_scale", 10.0}, {"fuse", 3}};
  d.inputs = {{"foreground", features, Content::kSignal},
              {"background", features, Content::kSignal},
              {"mask", {1, 1, features[2] * finer, features[3] * finer}, Content::kUnit}};
  if (r.chance(0.5)) d.inputs.push_back({"fuse_weight", {1, 1, 3, 3}, Content::kPicture});
  return d;
}

// Pooling and resampling.

CallDraft pool_draft(Random& r, bool average) {
  const std::array<std::int64_t, 2> kernel = {r.integer(1, 4), r.integer(1, 4)};
  std::array<std::int64_t, 4> padding{};
  if (r.chance(0.6))
    for (std::size_t i = 0; i < 4; ++i) padding[i] = r.integer(0, kernel[i % 2] / 2);
  CallDraft d;
  d.attributes = {{"kernel", kernel},
                  {"stride", {r.integer(1, 3), r.integer(1, 3)}},
                  {"padding", padding},
                  {"ceil_mode", r.chance(0.5)}};
  if (average) d.attributes["count_include_pad"] = r.chance(0.5);
  const Shape x{r.integer(1, 2), extent(r, 17), std::max(extent(r, 25), kernel[0]),
                std::max(extent(r, 65), kernel[1])};
  d.inputs = {{"x", x, Content::kSignal}};
  return d;
}

CallDraft resize_draft(Random& r) {
  const Shape x = picture(r, extent(r, 5));
  const char* mode = r.pick({"nearest", "linear", "linear", "cubic"});
  CallDraft d;
  // Nearest: by whole factors, or which pixel is nearest would hang on a rounding of the coordinate.
  const bool nearest = std::string_view(mode) == "nearest";
  const std::int64_t factor = r.integer(1, 3);
  const auto size = [&](std::int64_t from) { return nearest ? factor * from : extent(r, 65); };
  d.attributes = {
      {"mode", mode},
      {"coordinates", nearest ? r.pick({"half_pixel", "asymmetric"})
                              : r.pick({"half_pixel", "pytorch_half_pixel", "align_corners", "asymmetric"})},
      {"size", {size(x[2]), size(x[3])}},
      {"nearest", "floor"},
      {"cubic_a", r.pick({-0.75, -0.5})}};
  d.inputs = {{"x", x, Content::kSignal}};
  return d;
}

// Shapes, reductions, norms.

CallDraft concat_draft(Random& r) {
  const Shape first = any_shape(r);
  const auto axis = static_cast<int>(r.integer(0, first.rank() - 1));
  CallDraft d;
  d.attributes["axis"] = r.chance(0.3) ? axis - first.rank() : axis;
  const std::int64_t count = r.integer(1, 4);
  for (std::int64_t i = 0; i < count; ++i)
    d.inputs.push_back({"x" + std::to_string(i), first.with(axis, extent(r, 17)), Content::kSignal});
  return d;
}

CallDraft slice_draft(Random& r) {
  const Shape x = any_shape(r);
  const auto axis = static_cast<int>(r.integer(0, x.rank() - 1));
  const std::int64_t start = r.integer(0, x[axis] - 1);
  CallDraft d;
  d.attributes = {{"axis", axis}, {"start", start}, {"end", r.integer(start + 1, x[axis])}};
  d.inputs = {{"x", x, Content::kSignal}};
  return d;
}

CallDraft pad_draft(Random& r) {
  const Shape x = picture(r, extent(r, 5));
  const char* mode = r.pick({"constant", "edge", "reflect"});
  std::array<std::int64_t, 4> padding{};
  for (std::size_t i = 0; i < 4; ++i)
    padding[i] = r.integer(0, std::string_view(mode) == "reflect"
                                  ? std::min<std::int64_t>(5, x[2 + static_cast<int>(i % 2)] - 1)
                                  : 5);
  CallDraft d;
  d.attributes = {{"padding", padding}, {"mode", mode}, {"value", r.pick({0.0, -1.5})}};
  d.inputs = {{"x", x, Content::kSignal}};
  return d;
}

CallDraft reshape_draft(Random& r) {
  const Shape x = any_shape(r);
  CallDraft d;
  d.attributes["shape"] = r.chance(0.5) ? Json::array({x.count()}) : Json::array({1, x.count(), 1});
  d.inputs = {{"x", x, Content::kSignal}};
  return d;
}

CallDraft permute_draft(Random& r) {
  const Shape x = any_shape(r);
  std::vector<int> axes;
  for (int i = 0; i < x.rank(); ++i) axes.insert(axes.begin() + r.integer(0, i), i);
  CallDraft d;
  d.attributes["axes"] = axes;
  d.inputs = {{"x", x, Content::kSignal}};
  return d;
}

CallDraft reduce_draft(Random& r) {
  const Shape x = any_shape(r);
  std::vector<int> axes;
  for (int i = 0; i < x.rank(); ++i)
    if (r.chance(0.5)) axes.push_back(i);
  if (axes.empty()) axes.push_back(-1);
  CallDraft d;
  d.attributes["axes"] = axes;
  d.inputs = {{"x", x, Content::kSignal}};
  return d;
}

CallDraft softmax_draft(Random& r) {
  const Shape x = any_shape(r);
  CallDraft d;
  d.attributes["axis"] = r.integer(-x.rank(), x.rank() - 1);
  d.inputs = {{"x", x, Content::kSignal}};
  return d;
}

void add_affine(CallDraft& d, std::int64_t n) {
  d.inputs.push_back({"weight", {n}, Content::kParameter});
  d.inputs.push_back({"bias", {n}, Content::kParameter});
}

CallDraft batch_norm_draft(Random& r) {
  const Shape x = picture(r, extent(r, 17));
  CallDraft d;
  d.attributes["eps"] = r.pick({1e-5, 1e-3});
  d.inputs = {{"x", x, Content::kSignal}};
  add_affine(d, x[1]);
  d.inputs.push_back({"running_mean", {x[1]}, Content::kParameter});
  d.inputs.push_back({"running_var", {x[1]}, Content::kPositive});
  return d;
}

CallDraft group_norm_draft(Random& r) {
  const std::int64_t groups = r.integer(1, 4);
  const Shape x = picture(r, groups * extent(r, 5));
  CallDraft d;
  d.attributes = {{"groups", groups}, {"eps", 1e-5}};
  d.inputs = {{"x", x, Content::kSignal}};
  add_affine(d, x[1]);
  return d;
}

CallDraft layer_norm_draft(Random& r) {
  const Shape x = any_shape(r);
  const auto axis = static_cast<int>(r.integer(0, x.rank() - 1));
  CallDraft d;
  d.attributes = {{"axis", axis}, {"eps", r.pick({1e-5, 1e-6})}};
  d.inputs = {{"x", x, Content::kSignal}};
  add_affine(d, x[axis]);
  return d;
}

// Pointwise.

CallDraft unary_draft(Random& r, const Json& attributes) {
  CallDraft d;
  d.attributes = attributes;
  d.inputs = {{"x", any_shape(r), Content::kSignal}};
  return d;
}

CallDraft binary_draft(Random& r) {
  const Shape x = any_shape(r);
  Shape other = x;
  for (int i = 0; i < x.rank(); ++i)
    if (r.chance(0.25)) other = other.with(i, 1);
  const bool swapped = r.chance(0.25);
  CallDraft d;
  d.inputs = {{"x", swapped ? other : x, Content::kSignal}, {"other", swapped ? x : other, Content::kSignal}};
  return d;
}

// Layering.

CallDraft plane_draft(Random& r, const Json& attributes, std::int64_t most_channels) {
  CallDraft d;
  d.attributes = attributes;
  d.inputs = {{"x", picture(r, extent(r, most_channels)), Content::kSignal}};
  return d;
}

CallDraft fill_draft(Random& r, const Json& attributes) {
  CallDraft d = plane_draft(r, attributes, 5);
  d.inputs.push_back({"weight", d.inputs[0].shape.with(1, 1), Content::kUnit});
  return d;
}

CallDraft guided_draft(Random& r) {
  const Shape guide = picture(r, r.integer(1, 4));
  CallDraft d;
  d.bounded = true;
  d.attributes = {{"radius", r.integer(0, 4)}, {"eps", r.pick({1e-2, 1e-4})}};
  d.inputs = {{"guide", guide, Content::kPicture}, {"x", guide.with(1, 1), Content::kPicture}};
  return d;
}

CallDraft foreground_draft(Random& r) {
  const Shape image = picture(r, r.integer(1, 4));
  CallDraft d;
  d.bounded = true;
  d.inputs = {{"image", image, Content::kPicture}, {"alpha", image.with(1, 1), Content::kUnit}};
  return d;
}

using Make = CallDraft (*)(Random&);
struct Entry {
  std::string_view op;
  Make make;
};

CallDraft plain_unary(Random& r) { return unary_draft(r, Json::object()); }
CallDraft x_alone(Random& r) { return plane_draft(r, Json::object(), 17); }

constexpr Entry kEntries[] = {
    {"conv2d", [](Random& r) { return convolution_draft(r, false); }},
    {"gated_conv2d", [](Random& r) { return convolution_draft(r, true); }},
    {"attention", attention_draft},
    {"contextual_attention", contextual_attention_draft},
    {"max_pool2d", [](Random& r) { return pool_draft(r, false); }},
    {"avg_pool2d", [](Random& r) { return pool_draft(r, true); }},
    {"global_avg_pool2d", x_alone},
    {"adaptive_avg_pool2d",
     [](Random& r) {
       return plane_draft(r, {{"size", {extent(r, 9), extent(r, 9)}}}, 17);
     }},
    {"resize", resize_draft},
    {"upsample_nearest",
     [](Random& r) {
       return plane_draft(r, {{"factor", r.integer(1, 4)}}, 5);
     }},
    {"relu", plain_unary},
    {"relu6", plain_unary},
    {"leaky_relu",
     [](Random& r) {
       return unary_draft(r, {{"slope", r.pick({0.01, 0.2, -0.5})}});
     }},
    {"elu",
     [](Random& r) {
       return unary_draft(r, {{"alpha", r.pick({1.0, 0.3, 2.0})}});
     }},
    {"sigmoid", plain_unary},
    {"tanh", plain_unary},
    {"exp", plain_unary},
    {"sqrt", plain_unary},
    {"abs", plain_unary},
    {"clip",
     [](Random& r) {
       return unary_draft(r, {{"min", r.pick({-1.0, -0.25})}, {"max", r.pick({0.5, 6.0})}});
     }},
    {"affine",
     [](Random& r) {
       return unary_draft(r, {{"scale", r.pick({0.5, -3.0, 1.0 / 3})}, {"shift", r.pick({0.0, -0.1, 7.0})}});
     }},
    {"silu", plain_unary},
    {"gelu", plain_unary},
    {"greater",
     [](Random& r) {
       return unary_draft(r, {{"threshold", r.pick({0.0, 0.5, -1.0})}});
     }},
    {"add", binary_draft},
    {"sub", binary_draft},
    {"mul", binary_draft},
    {"div", binary_draft},
    {"minimum", binary_draft},
    {"maximum", binary_draft},
    {"concat", concat_draft},
    {"slice", slice_draft},
    {"pad", pad_draft},
    {"reshape", reshape_draft},
    {"permute", permute_draft},
    {"softmax", softmax_draft},
    {"reduce_min", reduce_draft},
    {"reduce_max", reduce_draft},
    {"reduce_mean", reduce_draft},
    {"batch_norm", batch_norm_draft},
    {"group_norm", group_norm_draft},
    {"layer_norm", layer_norm_draft},
    {"weight_standardise",
     [](Random& r) {
       CallDraft d;
       d.attributes["eps"] = r.pick({1e-5, 1e-10});
       d.inputs = {
           {"weight", {extent(r, 17), extent(r, 17), r.integer(1, 3), r.integer(1, 3)}, Content::kSignal}};
       return d;
     }},
    {"min_max_normalise", plain_unary},
    {"gaussian_blur",
     [](Random& r) {
       return plane_draft(r, {{"sigma", r.pick({0.0, 0.5, 1.0, 2.5})}}, 5);
     }},
    {"mirror_known", [](Random& r) { return fill_draft(r, Json::object()); }},
    {"push_pull_fill",
     [](Random& r) {
       return fill_draft(r, {{"sweeps", r.integer(0, 4)}});
     }},
    {"guided_coefficients", guided_draft},
    {"foreground_colours", foreground_draft},
    {"median",
     [](Random& r) {
       return plane_draft(r, {{"radius", r.integer(0, 3)}}, 5);
     }},
    {"sobel", [](Random& r) { return plane_draft(r, Json::object(), 1); }},
    {"cone_dilation",
     [](Random& r) {
       return plane_draft(r, {{"rho", r.pick({0.0, 0.03, 0.25})}, {"radius", r.integer(0, 12)}}, 5);
     }},
    {"distance_transform", [](Random& r) { return plane_draft(r, Json::object(), 5); }},
};

}  // namespace

CallDraft draft_call(std::string_view op, Random& random) {
  const auto* entry = std::ranges::find(kEntries, op, &Entry::op);
  if (entry == std::end(kEntries))
    throw Error(ErrorKind::kUsage, "there is no operator " + std::string(op.substr(0, 40)),
                "docs/operators.md lists all");
  return entry->make(random);
}

}  // namespace slide::ops
