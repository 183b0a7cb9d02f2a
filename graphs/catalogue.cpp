#include "graphs/catalogue.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <string>

#include "graphs/depth_anything_v2.h"
#include "graphs/fba.h"
#include "graphs/inpaint_coarse.h"
#include "graphs/inpaint_deepfill.h"
#include "graphs/midas_v21.h"
#include "graphs/midas_v21_small.h"
#include "graphs/slide_depth.h"
#include "graphs/slide_inpaint.h"
#include "graphs/slide_matte.h"
#include "graphs/slide_rim.h"
#include "graphs/u2net.h"
#include "runtime/error.h"

namespace slide::graphs {
namespace {

using GraphPtr = std::unique_ptr<Graph>;

Value image_input(Graph& g, std::string_view name, std::int64_t channels, const BuildOptions& options) {
  return g.input(name, {1, channels, options.height, options.width});
}

GraphPtr build_midas_v21(const BuildOptions& options) {
  auto g = std::make_unique<Graph>();
  g->output("0", midas_v21(image_input(*g, "x", 3, options)));
  return g;
}

GraphPtr build_midas_v21_small(const BuildOptions& options) {
  auto g = std::make_unique<Graph>();
  g->output("0", midas_v21_small(image_input(*g, "x", 3, options)));
  return g;
}

template <const DepthAnythingV2Config& kConfig>
GraphPtr build_depth_anything_v2(const BuildOptions& options) {
  auto g = std::make_unique<Graph>();
  g->output("0", depth_anything_v2(image_input(*g, "x", 3, options), kConfig));
  return g;
}

GraphPtr build_inpaint_coarse(const BuildOptions& options) {
  InpaintCoarseConfig config;
  if (options.weights != nullptr) config = InpaintCoarseConfig::from_weights(*options.weights);
  auto g = std::make_unique<Graph>();
  const Value rgbd = image_input(*g, "rgbd", config.image_channels, options);
  const Value mask = image_input(*g, "mask", 1, options);
  g->output("0", inpaint_coarse(rgbd, mask, config));
  return g;
}

GraphPtr build_inpaint_deepfill(const BuildOptions& options) {
  InpaintDeepfillConfig config;
  if (options.weights != nullptr) config = InpaintDeepfillConfig::from_weights(*options.weights);
  auto g = std::make_unique<Graph>();
  const Value rgbd = image_input(*g, "rgbd", config.image_channels, options);
  const Value mask = image_input(*g, "mask", 1, options);
  const InpaintDeepfillResult result = inpaint_deepfill(rgbd, mask, config);
  g->output("0", result.coarse);
  g->output("1", result.refined);
  return g;
}

GraphPtr build_u2net(const BuildOptions& options, std::array<Value, 7> (*network)(Value)) {
  auto g = std::make_unique<Graph>();
  int index = 0;
  for (const Value& map : network(image_input(*g, "x", 3, options))) g->output(std::to_string(index++), map);
  return g;
}

GraphPtr build_fba(const BuildOptions& options) {
  FbaConfig config;
  if (options.weights != nullptr && !options.weights_as_used)
    config = FbaConfig::from_weights(*options.weights);
  auto g = std::make_unique<Graph>();
  const FbaInputs inputs{.image = image_input(*g, "image", 3, options),
                         .two_chan_trimap = image_input(*g, "two_chan_trimap", 2, options),
                         .image_n = image_input(*g, "image_n", 3, options),
                         .trimap_transformed = image_input(*g, "trimap_transformed", 6, options)};
  g->output("0", fba(inputs, config));
  return g;
}

GraphPtr build_slide_depth(const BuildOptions& options) {
  auto g = std::make_unique<Graph>();
  g->output("0", slide_depth(image_input(*g, "x", 3, options)));
  return g;
}

GraphPtr build_slide_inpaint(const BuildOptions& options) {
  auto g = std::make_unique<Graph>();
  const Value rgbd = image_input(*g, "rgbd", 4, options);
  const Value disparity = image_input(*g, "disparity", 1, options);
  const Value hole = image_input(*g, "hole", 1, options);
  g->output("0", slide_inpaint(rgbd, disparity, hole));
  return g;
}

GraphPtr build_slide_matte(const BuildOptions& options) {
  auto g = std::make_unique<Graph>();
  g->output("0", slide_matte(image_input(*g, "x", 3, options)));
  return g;
}

GraphPtr build_slide_rim(const BuildOptions& options) {
  auto g = std::make_unique<Graph>();
  const Value image = image_input(*g, "image", 3, options);
  g->output("0", slide_rim(image, image_input(*g, "coarse", 1, options)));
  return g;
}

/// The project's own networks.
std::vector<Model> own_models() {
  return {
      {.name = "slide_depth",
       .description = "inverse depth of an image, the default (2.3 M parameters)",
       .inputs = {"x"},
       .outputs = {"inverse depth"},
       .size = {.multiple = 32, .upper_bound = kSlideSide},
       .unread = {},
       .build = build_slide_depth},
      {.name = "slide_inpaint",
       .description = "depth-aware RGBD inpainting, the default",
       .inputs = {"rgbd", "disparity", "hole"},
       .outputs = {"rgbd"},
       .size = {.multiple = 8},
       .unread = {},
       .build = build_slide_inpaint},
      {.name = "slide_matte",
       .description = "soft matte of the salient subject, the default",
       .inputs = {"x"},
       .outputs = {"matte"},
       .size = {.multiple = 32, .upper_bound = kSlideSide},
       .unread = {},
       .build = build_slide_matte},
      {.name = "slide_rim",
       .description = "a coarse matte's edges and hair at the photo's size, the default",
       .inputs = {"image", "coarse"},
       .outputs = {"matte"},
       .size = {.multiple = 8},
       .unread = {},
       .build = build_slide_rim},
  };
}

/// Depth Anything V2 in one of its sizes.
Model depth_anything_model(std::string_view name, std::string_view description,
                           GraphPtr (*build)(const BuildOptions&)) {
  return {.name = name,
          .description = description,
          .inputs = {"x"},
          .outputs = {"disparity"},
          .size = {.multiple = 14, .upper_bound = 518},
          .unread = {"pretrained.mask_token", "depth_head.scratch.refinenet4.resConfUnit1."},
          .build = build};
}

/// Published networks, whose weights are their authors'.
std::vector<Model> published_models() {
  const std::vector<std::string_view> maps{"fused",  "side 1", "side 2", "side 3",
                                           "side 4", "side 5", "side 6"};
  return {
      {.name = "midas_v21",
       .description = "MiDaS v2.1: inverse depth of an image (ResNeXt-101 encoder, 105 M parameters)",
       .inputs = {"x"},
       .outputs = {"inverse depth"},
       .size = {.multiple = 32, .upper_bound = 384},
       .unread = {"scratch.refinenet4.resConfUnit1."},
       .build = build_midas_v21},
      {.name = "midas_v21_small",
       .description = "MiDaS v2.1 small: inverse depth of an image (EfficientNet-Lite3 encoder, 21 M)",
       .inputs = {"x"},
       .outputs = {"inverse depth"},
       .size = {.multiple = 32, .upper_bound = 256},
       .unread = {"scratch.refinenet4.resConfUnit1."},
       .build = build_midas_v21_small},
      depth_anything_model("depth_anything_v2_vits",
                           "Depth Anything V2 Small: disparity of an image (ViT-S, 25 M)",
                           build_depth_anything_v2<kDepthAnythingV2Small>),
      depth_anything_model("depth_anything_v2_vitb",
                           "Depth Anything V2 Base: disparity of an image (ViT-B, 97 M)",
                           build_depth_anything_v2<kDepthAnythingV2Base>),
      depth_anything_model("depth_anything_v2_vitl",
                           "Depth Anything V2 Large: disparity of an image (ViT-L, 335 M)",
                           build_depth_anything_v2<kDepthAnythingV2Large>),
      {.name = "inpaint_coarse",
       .description = "SLIDE's coarse RGBD inpainting network",
       .inputs = {"rgbd", "mask"},
       .outputs = {"rgbd"},
       .size = {.multiple = 4},
       .unread = {},
       .build = build_inpaint_coarse},
      {.name = "inpaint_deepfill",
       .description = "DeepFillv2: coarse and refined inpainting with contextual attention, RGBD (4.1 M)",
       .inputs = {"rgbd", "mask"},
       .outputs = {"coarse rgbd", "refined rgbd"},
       .size = {.multiple = 8},
       .unread = {},
       .build = build_inpaint_deepfill},
      {.name = "u2net",
       .description = "U²-Net: salient object maps (44 M)",
       .inputs = {"x"},
       .outputs = maps,
       .size = {.square = 320},
       .unread = {},
       .build = [](const BuildOptions& options) { return build_u2net(options, u2net); }},
      {.name = "u2netp",
       .description = "U²-NetP: salient object maps (1.1 M)",
       .inputs = {"x"},
       .outputs = maps,
       .size = {.square = 320},
       .unread = {},
       .build = [](const BuildOptions& options) { return build_u2net(options, u2netp); }},
      {.name = "fba",
       .description = "FBA matting: alpha, foreground and background from an image and a trimap (35 M)",
       .inputs = {"image", "two_chan_trimap", "image_n", "trimap_transformed"},
       .outputs = {"alpha, foreground RGB, background RGB"},
       .size = {.multiple = 8},
       .unread = {},
       .build = build_fba},
  };
}

}  // namespace

std::span<const Model> catalogue() {
  static const std::vector<Model> models = [] {
    std::vector<Model> all = published_models();
    std::ranges::move(own_models(), std::back_inserter(all));
    return all;
  }();
  return models;
}

const Model& find_model(std::string_view name) {
  const std::span<const Model> models = catalogue();
  const auto found = std::ranges::find(models, name, &Model::name);
  if (found != models.end()) return *found;
  std::string known;
  for (const Model& model : models) known += (known.empty() ? "" : ", ") + std::string(model.name);
  throw Error(ErrorKind::kUsage, "there is no model named " + std::string(name), "the models are " + known);
}

std::unique_ptr<Graph> build_model(std::string_view name, const BuildOptions& options) {
  const Model& model = find_model(name);
  if (options.height < 1 || options.width < 1)
    throw Error(ErrorKind::kUsage, std::string(name) + ": the size " + std::to_string(options.height) + "x" +
                                       std::to_string(options.width) + " is empty");
  return model.build(options);
}

}  // namespace slide::graphs
