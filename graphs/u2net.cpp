#include "graphs/u2net.h"

#include <string>
#include <vector>

#include "graphs/layers.h"
#include "ops/pointwise/pointwise.h"
#include "ops/pool/pool.h"
#include "ops/resize/resize.h"
#include "ops/tensor_shape/tensor_shape.h"

namespace slide::graphs {
namespace {

/// Channels of one nested block: inside it and of its result.
struct BlockWidth {
  std::int64_t middle, output;
};

struct U2NetWidths {
  BlockWidth stage1, stage2, stage3, stage4, stage5, stage6;
  BlockWidth stage5d, stage4d, stage3d, stage2d, stage1d;
};

constexpr U2NetWidths kFull{.stage1 = {32, 64},
                            .stage2 = {32, 128},
                            .stage3 = {64, 256},
                            .stage4 = {128, 512},
                            .stage5 = {256, 512},
                            .stage6 = {256, 512},
                            .stage5d = {256, 512},
                            .stage4d = {128, 256},
                            .stage3d = {64, 128},
                            .stage2d = {32, 64},
                            .stage1d = {16, 64}};

constexpr BlockWidth kSmallBlock{16, 64};
constexpr U2NetWidths kSmall{kSmallBlock, kSmallBlock, kSmallBlock, kSmallBlock, kSmallBlock, kSmallBlock,
                             kSmallBlock, kSmallBlock, kSmallBlock, kSmallBlock, kSmallBlock};

Value rebnconv(Value x, const std::string& name, std::int64_t channels, std::int64_t dilation = 1) {
  const auto scope = x.graph().scope(name);
  x = conv2d(x, "conv_s1", {.filters = channels, .dilation = dilation});
  return ops::relu(batch_norm(x, "bn_s1"));
}

Value pool(Value x) { return ops::max_pool2d(x, {.kernel = {2, 2}, .stride = {2, 2}, .ceil_mode = true}); }

Value upsample_like(Value x, Value target) {
  return ops::resize_bilinear(x, target.shape()[2], target.shape()[3], false);
}

std::string numbered(std::string_view base, int n, std::string_view suffix = "") {
  return std::string(base) + std::to_string(n) + std::string(suffix);
}

/// RSU-L, a U-shaped residual block of `height` levels: rebnconv1 to rebnconv<L-1> with pooling between them,
/// rebnconv<L> dilated at the coarsest level, then the way back up.
Value rsu(Value x, std::string_view name, int height, BlockWidth width) {
  const auto scope = x.graph().scope(name);
  const Value in = rebnconv(x, "rebnconvin", width.output);
  std::vector<Value> down{rebnconv(in, "rebnconv1", width.middle)};
  for (int i = 2; i < height; ++i)
    down.push_back(rebnconv(pool(down.back()), numbered("rebnconv", i), width.middle));
  Value up = rebnconv(down.back(), numbered("rebnconv", height), width.middle, 2);
  for (int i = height - 1; i >= 1; --i) {
    const Value level = down[static_cast<std::size_t>(i - 1)];
    if (i < height - 1) up = upsample_like(up, level);
    up = rebnconv(ops::concat({up, level}, 1), numbered("rebnconv", i, "d"),
                  i == 1 ? width.output : width.middle);
  }
  return ops::add(up, in);
}

/// RSU-4F: no pooling; dilations 1, 2, 4, 8 and back instead.
Value rsu4f(Value x, std::string_view name, BlockWidth width) {
  const auto scope = x.graph().scope(name);
  const Value in = rebnconv(x, "rebnconvin", width.output);
  const Value down1 = rebnconv(in, "rebnconv1", width.middle, 1);
  const Value down2 = rebnconv(down1, "rebnconv2", width.middle, 2);
  const Value down3 = rebnconv(down2, "rebnconv3", width.middle, 4);
  const Value bottom = rebnconv(down3, "rebnconv4", width.middle, 8);
  const Value up3 = rebnconv(ops::concat({bottom, down3}, 1), "rebnconv3d", width.middle, 4);
  const Value up2 = rebnconv(ops::concat({up3, down2}, 1), "rebnconv2d", width.middle, 2);
  const Value up1 = rebnconv(ops::concat({up2, down1}, 1), "rebnconv1d", width.output, 1);
  return ops::add(up1, in);
}

Value joined(Value coarse, Value fine) { return ops::concat({upsample_like(coarse, fine), fine}, 1); }

std::array<Value, 7> nested_u(Value x, const U2NetWidths& w) {
  const Value hx1 = tapped("stage1", rsu(x, "stage1", 7, w.stage1));
  const Value hx2 = tapped("stage2", rsu(pool(hx1), "stage2", 6, w.stage2));
  const Value hx3 = tapped("stage3", rsu(pool(hx2), "stage3", 5, w.stage3));
  const Value hx4 = tapped("stage4", rsu(pool(hx3), "stage4", 4, w.stage4));
  const Value hx5 = tapped("stage5", rsu4f(pool(hx4), "stage5", w.stage5));
  const Value hx6 = tapped("stage6", rsu4f(pool(hx5), "stage6", w.stage6));

  const Value hx5d = tapped("stage5d", rsu4f(joined(hx6, hx5), "stage5d", w.stage5d));
  const Value hx4d = tapped("stage4d", rsu(joined(hx5d, hx4), "stage4d", 4, w.stage4d));
  const Value hx3d = tapped("stage3d", rsu(joined(hx4d, hx3), "stage3d", 5, w.stage3d));
  const Value hx2d = tapped("stage2d", rsu(joined(hx3d, hx2), "stage2d", 6, w.stage2d));
  const Value hx1d = tapped("stage1d", rsu(joined(hx2d, hx1), "stage1d", 7, w.stage1d));

  const Value d1 = conv2d(hx1d, "side1", {.filters = 1});
  const Value d2 = upsample_like(conv2d(hx2d, "side2", {.filters = 1}), d1);
  const Value d3 = upsample_like(conv2d(hx3d, "side3", {.filters = 1}), d1);
  const Value d4 = upsample_like(conv2d(hx4d, "side4", {.filters = 1}), d1);
  const Value d5 = upsample_like(conv2d(hx5d, "side5", {.filters = 1}), d1);
  const Value d6 = upsample_like(conv2d(hx6, "side6", {.filters = 1}), d1);
  const Value d0 = conv2d(ops::concat({d1, d2, d3, d4, d5, d6}, 1), "outconv", {.filters = 1, .kernel = 1});

  return {ops::sigmoid(d0), ops::sigmoid(d1), ops::sigmoid(d2), ops::sigmoid(d3),
          ops::sigmoid(d4), ops::sigmoid(d5), ops::sigmoid(d6)};
}

}  // namespace

std::array<Value, 7> u2net(Value x) {
  require_image("u2net", x, 3, 1);
  return nested_u(x, kFull);
}

std::array<Value, 7> u2netp(Value x) {
  require_image("u2netp", x, 3, 1);
  return nested_u(x, kSmall);
}

}  // namespace slide::graphs
