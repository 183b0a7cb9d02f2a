#include "graphs/depth_anything_v2.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "graphs/layers.h"
#include "graphs/midas_blocks.h"
#include "ops/attention/attention.h"
#include "ops/conv2d/conv2d.h"
#include "ops/pointwise/pointwise.h"
#include "ops/resize/resize.h"
#include "ops/tensor_shape/tensor_shape.h"
#include "runtime/error.h"

namespace slide::graphs {
namespace {

constexpr std::int64_t kPatch = 14;
constexpr std::int64_t kGrid = 37;  // of the position embedding: trained at 518×518
constexpr double kLayerNormEps = 1e-6;

/// 1×C×1×T, as tokens are kept here, in the authors' order 1×T×C.
Value as_rows(Value tokens) {
  const Shape& s = tokens.shape();
  return ops::permute(ops::reshape(tokens, {1, s[1], s[3]}), {0, 2, 1});
}

/// A tap for tools, of a value in the authors' order.
Value tapped_rows(std::string_view name, Value tokens) {
  static_cast<void>(tapped(name, as_rows(tokens)));
  return tokens;
}

/// interpolate_pos_encoding() of the patches' part: bicubic, the scale factor with an offset of 0.1 by which
/// DINOv2 keeps the size from being rounded down; untouched where the grid is the one trained.
/// @return 1×C×h×w
Value patch_positions(Value pos_embed, std::int64_t channels, std::int64_t height, std::int64_t width) {
  constexpr double kOffset = 0.1;
  Value grid = ops::reshape(ops::slice(pos_embed, 1, 1, 1 + kGrid * kGrid), {1, kGrid, kGrid, channels});
  grid = ops::permute(grid, {0, 3, 1, 2});
  if (height == kGrid && width == kGrid) return grid;
  ops::ResizeParams params;
  params.mode = ops::ResizeMode::kCubic;
  params.size = {height, width};
  params.scale = {
      {(static_cast<double>(height) + kOffset) / kGrid, (static_cast<double>(width) + kOffset) / kGrid}};
  return ops::resize(grid, params);
}

/// prepare_tokens_with_masks(): the class token, then the patches' in row-major order, each with its
/// position.
Value tokens_of(Value x, std::int64_t channels) {
  Graph& g = x.graph();
  const std::int64_t height = x.shape()[2] / kPatch;
  const std::int64_t width = x.shape()[3] / kPatch;
  const Value cls_token = g.parameter("cls_token", {1, 1, channels});
  const Value pos_embed = g.parameter("pos_embed", {1, 1 + kGrid * kGrid, channels});
  const auto embed = [&] {
    const auto scope = g.scope("patch_embed");
    const auto proj = g.scope("proj");
    const Value weight = g.parameter("weight", {channels, 3, kPatch, kPatch});
    ops::Conv2dParams params;
    params.stride = {kPatch, kPatch};
    return ops::conv2d(x, weight, g.parameter("bias", {channels}), params);
  };
  const Value patches = embed();
  tapped_rows("patch_embed", ops::reshape(patches, {1, channels, 1, height * width}));
  const Value placed = ops::add(patches, patch_positions(pos_embed, channels, height, width));
  const Value first = ops::add(cls_token, ops::slice(pos_embed, 1, 0, 1));
  return ops::concat(
      {ops::reshape(first, {1, channels, 1, 1}), ops::reshape(placed, {1, channels, 1, height * width})}, 3);
}

/// Attention: the heads' channels lie one behind another in q, k and v, and these in qkv. `gamma` is the
/// LayerScale behind it.
Value attention(Value x, std::int64_t heads, std::string_view gamma) {
  Graph& g = x.graph();
  const std::int64_t channels = x.shape()[1];
  const auto heads_attend = [&] {
    const auto scope = g.scope("attn");
    const Value qkv = linear(x, "qkv", 3 * channels);
    const auto part = [&](std::int64_t i) { return ops::slice(qkv, 1, i * channels, (i + 1) * channels); };
    const std::int64_t channels_each = channels / heads;
    const double scale = 1 / std::sqrt(static_cast<double>(channels_each));
    return ops::attention(part(0), part(1), part(2), heads, scale);
  };
  return scaled_linear(heads_attend(), "attn.proj", channels, gamma);
}

Value mlp(Value x, std::string_view gamma) {
  const std::int64_t channels = x.shape()[1];
  const Value hidden = ops::gelu(linear(x, "mlp.fc1", 4 * channels));
  return scaled_linear(hidden, "mlp.fc2", channels, gamma);
}

/// Block: x + ls1(attn(norm1(x))), then x + ls2(mlp(norm2(x))).
Value block(Value x, std::int64_t heads) {
  x = ops::add(x, attention(layer_norm(x, "norm1", kLayerNormEps), heads, "ls1.gamma"));
  return ops::add(x, mlp(layer_norm(x, "norm2", kLayerNormEps), "ls2.gamma"));
}

/// get_intermediate_layers(): the results of four blocks, normalised, without the class token, as images.
std::vector<Value> encode(Value x, const DepthAnythingV2Config& config) {
  Graph& g = x.graph();
  const auto scope = g.scope("pretrained");
  const std::int64_t height = x.shape()[2] / kPatch;
  const std::int64_t width = x.shape()[3] / kPatch;
  Value tokens = tokens_of(x, config.embed_dim);
  std::vector<Value> levels;
  for (std::int64_t i = 0; i < config.depth; ++i) {
    const std::string name = "blocks." + std::to_string(i);
    const auto run = [&] {
      const auto blocks = g.scope(name);
      return block(tokens, config.heads);
    };
    tokens = tapped_rows(name, run());
    if (std::ranges::find(config.layers, i) == config.layers.end()) continue;
    const Value normalised = layer_norm(tokens, "norm", kLayerNormEps);
    const Value patches = ops::slice(normalised, 3, 1, 1 + height * width);
    levels.push_back(ops::reshape(patches, {1, config.embed_dim, height, width}));
  }
  return levels;
}

/// The head's four levels: each projected, then at 4, 2, 1 and 1/2 times the patches' grid.
std::vector<Value> reassemble(const std::vector<Value>& tokens, const DepthAnythingV2Config& config) {
  std::vector<Value> levels;
  for (std::size_t i = 0; i < tokens.size(); ++i) {
    const std::string number = std::to_string(i);
    const std::int64_t channels = config.out_channels[i];
    const Value x = tapped("projects." + number,
                           conv2d(tokens[i], "projects." + number, {.filters = channels, .kernel = 1}));
    const std::string name = "resize_layers." + number;
    const auto resized = [&] {
      if (i < 2) return conv_transpose2d(x, name, channels, i == 0 ? 4 : 2);
      return i == 2 ? x : conv2d(x, name, {.filters = channels, .stride = 2});
    };
    levels.push_back(tapped(name, resized()));
  }
  return levels;
}

/// DPTHead.
Value decode(const std::vector<Value>& tokens, ImageSize image, const DepthAnythingV2Config& config) {
  Graph& g = tokens[0].graph();
  const auto head = g.scope("depth_head");
  std::vector<Value> levels = reassemble(tokens, config);
  const auto scope = g.scope("scratch");
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const std::string name = "layer" + std::to_string(i + 1) + "_rn";
    levels[i] = tapped(name, conv2d(levels[i], name, {.filters = config.features, .bias = false}));
  }
  const auto to_size_of = [&](const Value& next) {
    return FusionBlock{.skip = ResidualSkip::kAsGiven,
                       .out_channels = config.features,
                       .height = next.shape()[2],
                       .width = next.shape()[3]};
  };
  const FusionBlock twice{.skip = ResidualSkip::kAsGiven, .out_channels = config.features};
  Value path = tapped("refinenet4", fuse_features(levels[3], to_size_of(levels[2]), "refinenet4"));
  path = tapped("refinenet3", fuse_features(path, levels[2], to_size_of(levels[1]), "refinenet3"));
  path = tapped("refinenet2", fuse_features(path, levels[1], to_size_of(levels[0]), "refinenet2"));
  path = tapped("refinenet1", fuse_features(path, levels[0], twice, "refinenet1"));
  Value y = tapped("output_conv1", conv2d(path, "output_conv1", {.filters = config.features / 2}));
  y = ops::resize_bilinear(y, image.height, image.width, true);
  y = ops::relu(conv2d(y, "output_conv2.0", {.filters = 32}));
  return ops::relu(conv2d(y, "output_conv2.2", {.filters = 1, .kernel = 1}));
}

/// The multiple of 14 nearest to `side`, a tie to the even one as NumPy rounds, not below the bound.
std::int64_t rounded(double side, std::int64_t lower_bound) {
  const double steps = side / static_cast<double>(kPatch);
  const auto nearest = static_cast<std::int64_t>(std::nearbyint(steps)) * kPatch;
  return nearest < lower_bound ? static_cast<std::int64_t>(std::ceil(steps)) * kPatch : nearest;
}

}  // namespace

Value depth_anything_v2(Value x, const DepthAnythingV2Config& config) {
  require_image("depth_anything_v2", x, 3, kPatch);
  return decode(encode(x, config), {x.shape()[2], x.shape()[3]}, config);
}

ImageSize depth_anything_working_size(ImageSize image, std::int64_t shorter) {
  if (image.height < 1 || image.width < 1 || shorter < 1)
    throw Error(ErrorKind::kUsage, "Depth Anything V2 cannot bring an image of " +
                                       std::to_string(image.width) + "x" + std::to_string(image.height) +
                                       " pixels to at least " + std::to_string(shorter));
  const auto height = static_cast<double>(image.height);
  const auto width = static_cast<double>(image.width);
  const double scale = std::max(static_cast<double>(shorter) / height, static_cast<double>(shorter) / width);
  return {rounded(scale * height, shorter), rounded(scale * width, shorter)};
}

Value depth_anything_postprocess(Value depth, ImageSize image) {
  const auto scope = depth.graph().scope("depth_anything_postprocess");
  return ops::resize_bilinear(depth, image.height, image.width, true);
}

}  // namespace slide::graphs
