#include "graphs/slide_depth.h"

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "graphs/layers.h"
#include "graphs/midas_blocks.h"
#include "ops/pointwise/pointwise.h"
#include "ops/resize/resize.h"

namespace slide::graphs {
namespace {

constexpr std::int64_t kFeatures = 48;

/// A row of MobileNetV2's table 2: `repeats` inverted residuals, the first one strided.
struct Stage {
  std::int64_t expansion, channels, repeats, stride;
};
constexpr std::array<Stage, 7> kStages{{{1, 16, 1, 1},
                                        {6, 24, 2, 2},
                                        {6, 32, 3, 2},
                                        {6, 64, 4, 2},
                                        {6, 96, 3, 1},
                                        {6, 160, 3, 2},
                                        {6, 320, 1, 1}}};
/// The blocks after which the picture is at 1/4, 1/8, 1/16 and 1/32.
constexpr std::array<int, 4> kTaps{2, 5, 12, 16};

Value inverted_residual(Value x, std::int64_t expansion, std::int64_t channels, std::int64_t stride) {
  const std::int64_t hidden = x.shape()[1] * expansion;
  Value y = x;
  if (expansion != 1) y = ops::relu6(conv2d(y, "expand", {.filters = hidden, .kernel = 1}));
  y = ops::relu6(conv2d_tf_same(y, "depthwise", {.filters = hidden, .stride = stride, .groups = hidden}));
  y = conv2d(y, "project", {.filters = channels, .kernel = 1});
  return y.shape() == x.shape() && stride == 1 ? ops::add(x, y) : y;
}

std::vector<Value> encode(Value x) {
  Graph& g = x.graph();
  const auto encoder = g.scope("encoder");
  x = ops::relu6(conv2d_tf_same(x, "stem", {.filters = 32, .stride = 2}));
  std::vector<Value> taps;
  int block = 0;
  for (const Stage& stage : kStages)
    for (std::int64_t i = 0; i < stage.repeats; ++i, ++block) {
      const auto scope = g.scope("blocks." + std::to_string(block));
      x = inverted_residual(x, stage.expansion, stage.channels, i == 0 ? stage.stride : 1);
      if (block == kTaps[taps.size()]) taps.push_back(x);
    }
  return taps;
}

/// The path from below and this level's features through resConfUnit1, added; resConfUnit2, a 1×1
/// convolution, ×2.
Value fuse(Value path, std::optional<Value> level) {
  if (level) path = ops::add(path, residual_conv_unit(*level, "resConfUnit1", ResidualSkip::kAsGiven));
  path = residual_conv_unit(path, "resConfUnit2", ResidualSkip::kAsGiven);
  path = conv2d(path, "out_conv", {.filters = kFeatures, .kernel = 1});
  return ops::upsample_bilinear(path);
}

}  // namespace

Value slide_depth(Value x) {
  require_image("slide_depth", x, 3, 32);
  Graph& g = x.graph();
  const std::vector<Value> taps = encode(x);
  Value path = x;
  for (int i = 3; i >= 0; --i) {
    const Value level =
        conv2d(taps[static_cast<std::size_t>(i)], "layer_rn." + std::to_string(i), {.filters = kFeatures});
    const auto scope = g.scope("refine." + std::to_string(i));
    path = i == 3 ? fuse(level, std::nullopt) : fuse(path, level);
  }
  path = ops::relu(conv2d(path, "out1", {.filters = 24}));
  path = ops::upsample_bilinear(path);
  path = ops::relu(conv2d(path, "out2", {.filters = 16}));
  return conv2d(path, "out3", {.filters = 1, .kernel = 1});
}

}  // namespace slide::graphs
