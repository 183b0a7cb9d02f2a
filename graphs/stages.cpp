#include "graphs/stages.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

#include "graphs/catalogue.h"
#include "graphs/depth_anything_v2.h"
#include "graphs/edges.h"
#include "graphs/fba.h"
#include "graphs/inpaint_coarse.h"
#include "graphs/inpaint_deepfill.h"
#include "graphs/midas_io.h"
#include "graphs/midas_v21.h"
#include "graphs/midas_v21_small.h"
#include "graphs/neighbourhood.h"
#include "graphs/slide_depth.h"
#include "graphs/slide_inpaint.h"
#include "graphs/slide_matte.h"
#include "graphs/slide_rim.h"
#include "graphs/u2net.h"
#include "ops/guided/guided.h"
#include "ops/layering/distance_transform.h"
#include "ops/normalise/normalise.h"
#include "ops/pointwise/pointwise.h"
#include "ops/reduce/reduce.h"
#include "ops/resize/resize.h"
#include "ops/tensor_shape/tensor_shape.h"
#include "runtime/error.h"

namespace slide::graphs {
namespace {

constexpr std::int64_t kSaliencySide = 320;

/// A soft map above the one is foreground, up to the other background, before what is near the edge is taken
/// away.
constexpr double kForegroundFrom = 0.9;
constexpr double kBackgroundUpTo = 0.1;

/// The guided filters of slide_depth's disparity and slide_matte's matte: pixels of the working size, and
/// squared brightness.
constexpr std::int64_t kDepthGuideRadius = 4;
constexpr std::int64_t kMatteGuideRadius = 2;
constexpr double kGuideEps = 1e-3;

/// The smaller size that slide_matte sees a photo at, and the parts of the photo that a matte may cover there
/// up to which the larger size's is taken, and from which the smaller one's is.
constexpr std::int64_t kMatteWholeSide = 288;
constexpr double kSmallSubject = 0.25;
constexpr double kLargeSubject = 0.4;

/// The largest longer side that slide_rim works at, and what both sides are multiples of.
constexpr std::int64_t kRimSide = 1536;
constexpr std::int64_t kRimMultiple = 8;

/// FBA's sides; the length its trimap's Gaussians are measured in, and their widths in it.
constexpr std::int64_t kFbaMultiple = 8;
constexpr double kTrimapLength = 320;
constexpr double kTrimapWidths[] = {0.02, 0.08, 0.16};

ImageSize size_of_image(Value x) { return {x.shape()[2], x.shape()[3]}; }

Error wrong_model(const NetworkChoice& network, const std::string& role, const std::string& models) {
  return Error(ErrorKind::kUsage, "the model " + network.model + " is no " + role + " network",
               "one of: " + models);
}

/// Edge padding at the bottom and right to multiples of m.
Value pad_to_multiple(Value x, std::int64_t m) {
  const auto missing = [&](std::int64_t extent) { return (m - extent % m) % m; };
  const std::int64_t bottom = missing(x.shape()[2]);
  const std::int64_t right = missing(x.shape()[3]);
  return bottom == 0 && right == 0 ? x : ops::pad(x, {0, 0, bottom, right}, ops::PadMode::kEdge);
}

Value crop(Value x, ImageSize size) {
  if (x.shape()[2] != size.height) x = ops::slice(x, 2, 0, size.height);
  if (x.shape()[3] != size.width) x = ops::slice(x, 3, 0, size.width);
  return x;
}

/// 1 - x, for x of zeros and ones
Value complement(Value x) { return ops::affine(x, -1, 1); }

/// hole ? inside : outside, for a hole of zeros and ones
Value select(Value hole, Value inside, Value outside) {
  return ops::add(outside, ops::mul(hole, ops::sub(inside, outside)));
}

/// Completed RGBD in [0, 1] from RGBD in [0, 1].
Value complete(Value rgbd, Value hole, const NetworkChoice& network, const FillSources& sources) {
  const Value signed_rgbd = ops::affine(rgbd, 2, -1);
  const Value disparity = ops::slice(rgbd, 1, 3, 4);
  Value completed = signed_rgbd;
  if (!network.chosen())
    completed = background_fill(signed_rgbd, disparity, hole, sources);
  else if (network.model == "slide_inpaint")
    completed = slide_inpaint(signed_rgbd, disparity, hole, sources);
  else if (network.model == "inpaint_coarse")
    completed = inpaint_coarse(signed_rgbd, hole, InpaintCoarseConfig::from_weights(*network.weights));
  else if (network.model == "inpaint_deepfill")
    completed =
        inpaint_deepfill(signed_rgbd, hole, InpaintDeepfillConfig::from_weights(*network.weights)).refined;
  else
    throw wrong_model(network, "inpainting", "slide_inpaint, inpaint_coarse, inpaint_deepfill");
  return ops::clip(ops::affine(completed, 0.5, 0.5), 0, 1);
}

/// The photo with `side` pixels on its longer side, as slide_depth and slide_matte work at it.
Value slide_sized(Value image, std::int64_t side) {
  const ImageSize size = midas_working_size(size_of_image(image), side);
  return ops::resize_bicubic(image, size.height, size.width);
}

/// Such a photo as the networks take it, in [-1, 1].
Value slide_preprocess(Value sized) { return ops::affine(sized, 2, -1); }

/// y, kept between the extremes of the 3×3 pixels of `coarse` around each place: a guided filter overshoots.
Value within_neighbours(Value y, Value coarse) {
  const auto enlarged = [&](Value x) { return ops::resize_bilinear(x, y.shape()[2], y.shape()[3], false); };
  return ops::minimum(ops::maximum(y, enlarged(least_around(coarse, 1))),
                      enlarged(largest_around(coarse, 1)));
}

/// slide_depth's disparity, its edges brought onto the photo's: in [0, 1].
Value slide_disparity(Value image, std::int64_t side) {
  const Value sized = slide_sized(image, side);
  const Value coarse = ops::min_max_normalise(slide_depth(slide_preprocess(sized)));
  return within_neighbours(ops::guided_upsample(coarse, sized, image, kDepthGuideRadius, kGuideEps), coarse);
}

/// slide_matte's matte, in the same way. A subject that fills the photo is found whole where the photo is as
/// small as the crops that the network has learnt from; small ones need more pixels.
Value slide_photo_matte(Value image) {
  const Value sized = slide_sized(image, kSlideSide);
  const Value fine = slide_matte(slide_preprocess(sized));
  const Value whole = slide_matte(slide_preprocess(slide_sized(image, kMatteWholeSide)));
  const Value filled = smoothstep(ops::reduce_mean(whole, {2, 3}), kSmallSubject, kLargeSubject);
  const Value enlarged = ops::resize_bilinear(whole, fine.shape()[2], fine.shape()[3], false);
  const Value coarse = ops::add(fine, ops::mul(filled, ops::sub(enlarged, fine)));
  return ops::clip(ops::guided_upsample(coarse, sized, image, kMatteGuideRadius, kGuideEps), 0, 1);
}

/// slide_rim's matte: at the photo's size, or reduced to what it has learnt and enlarged with the photo as
/// guide. Sides are padded to multiples of 8 by the border pixel.
Value slide_refined(Value image, Value coarse) {
  const ImageSize size = size_of_image(image);
  const std::int64_t longer = std::max(size.height, size.width);
  if (longer <= kRimSide)
    return crop(slide_rim(pad_to_multiple(image, kRimMultiple), pad_to_multiple(coarse, kRimMultiple)), size);
  const auto reduced = [&](std::int64_t side) {
    const std::int64_t steps = (side * kRimSide + longer * kRimMultiple / 2) / (longer * kRimMultiple);
    return std::max<std::int64_t>(steps, 1) * kRimMultiple;
  };
  const auto small = [&](Value x) {
    return ops::clip(ops::resize_bicubic(x, reduced(size.height), reduced(size.width)), 0, 1);
  };
  const Value sized = small(image);
  const Value fine = slide_rim(sized, small(coarse));
  return ops::clip(ops::guided_upsample(fine, sized, image, kMatteGuideRadius, kGuideEps), 0, 1);
}

/// FBA's alpha, and exactly 0 and 1 in the sure regions of trimap().
Value fba_refined(Value image, Value saliency, const NetworkChoice& network) {
  const Value regions = trimap(saliency);
  const Value padded = pad_to_multiple(image, kFbaMultiple);
  const Value padded_regions = pad_to_multiple(regions, kFbaMultiple);
  const FbaInputs inputs{.image = padded,
                         .two_chan_trimap = padded_regions,
                         .image_n = imagenet_normalise(padded),
                         .trimap_transformed = trimap_transform(padded_regions)};
  const Value result = fba(inputs, FbaConfig::from_weights(*network.weights));
  const Value alpha = crop(ops::slice(result, 1, 0, 1), size_of_image(image));
  const Value background = ops::slice(regions, 1, 0, 1);
  const Value foreground = ops::slice(regions, 1, 1, 2);
  return ops::maximum(ops::mul(alpha, complement(background)), foreground);
}

/// The size of Depth Anything V2 that a model's name stands for; null for another network.
const DepthAnythingV2Config* depth_anything_config(std::string_view model) {
  if (model == "depth_anything_v2_vits") return &kDepthAnythingV2Small;
  if (model == "depth_anything_v2_vitb") return &kDepthAnythingV2Base;
  if (model == "depth_anything_v2_vitl") return &kDepthAnythingV2Large;
  return nullptr;
}

}  // namespace

std::int64_t depth_side(const NetworkChoice& network) {
  constexpr std::string_view kModels[] = {
      "slide_depth", "depth_anything_v2_vits", "depth_anything_v2_vitb", "depth_anything_v2_vitl",
      "midas_v21",   "midas_v21_small"};
  if (std::ranges::find(kModels, network.model) == std::end(kModels)) {
    std::string names;
    for (const std::string_view name : kModels) names.append(names.empty() ? "" : ", ").append(name);
    throw wrong_model(network, "depth", names);
  }
  const SizeRule& rule = find_model(network.model).size;
  if (network.side == 0) return rule.upper_bound;
  if (network.side < 1 || network.side % rule.multiple != 0) {
    const std::int64_t below = std::max(network.side / rule.multiple, std::int64_t{1}) * rule.multiple;
    throw Error(ErrorKind::kUsage,
                network.model + " cannot work at " + std::to_string(network.side) + " pixels",
                "a multiple of " + std::to_string(rule.multiple) + ": " + std::to_string(below) + " or " +
                    std::to_string(below + rule.multiple));
  }
  return network.side;
}

Value estimate_disparity(Value image, const NetworkChoice& network) {
  const auto sharpened = [&](Value d) { return sharpen_edges(ops::min_max_normalise(d), image); };
  const ImageSize size = size_of_image(image);
  const std::int64_t side = depth_side(network);
  if (network.model == "slide_depth") return sharpened(slide_disparity(image, side));
  if (const DepthAnythingV2Config* config = depth_anything_config(network.model)) {
    const Value x = midas_preprocess(image, depth_anything_working_size(size, side));
    return sharpened(depth_anything_postprocess(depth_anything_v2(x, *config), size));
  }
  const Value x = midas_preprocess(image, midas_working_size(size, side));
  return sharpened(midas_postprocess(network.model == "midas_v21" ? midas_v21(x) : midas_v21_small(x), size));
}

Value estimate_matte(Value image, const NetworkChoice& network) {
  const ImageSize size = size_of_image(image);
  if (network.model == "slide_matte") return slide_photo_matte(image);
  const Value brightest = ops::maximum(ops::reduce_max(image, {1, 2, 3}),
                                       ops::affine(ops::reduce_max(image, {1, 2, 3}), 0, 1e-6));
  const Value input = midas_preprocess(ops::div(image, brightest), {kSaliencySide, kSaliencySide});
  Value map = input;
  if (network.model == "u2net")
    map = u2net(input)[0];
  else if (network.model == "u2netp")
    map = u2netp(input)[0];
  else
    throw wrong_model(network, "saliency", "slide_matte, u2netp, u2net");
  return ops::resize_bilinear(ops::min_max_normalise(map), size.height, size.width, false);
}

Value trimap(Value saliency) {
  const ImageSize size = size_of_image(saliency);
  const double longer = static_cast<double>(std::max(size.height, size.width));
  const double r = std::max(2.0, std::round(longer / 100));
  const auto farther_than_r = [&](Value from) { return ops::greater(ops::distance_transform(from), r * r); };
  return ops::concat({farther_than_r(ops::greater(saliency, kBackgroundUpTo)),
                      farther_than_r(complement(ops::greater(saliency, kForegroundFrom)))},
                     1);
}

Value trimap_transform(Value two_chan_trimap) {
  const Value squared = ops::distance_transform(two_chan_trimap);
  std::vector<Value> gaussians;
  for (int region = 0; region < 2; ++region)
    for (const double width : kTrimapWidths) {
      const double sigma = width * kTrimapLength;
      const Value d = ops::slice(squared, 1, region, region + 1);
      gaussians.push_back(ops::exp(ops::affine(d, -1 / (2 * sigma * sigma), 0)));
    }
  return ops::concat(gaussians, 1);
}

Value refine_matte(Value image, Value saliency, const NetworkChoice& network) {
  if (network.model == "slide_rim") return slide_refined(image, saliency);
  if (network.model == "fba") return fba_refined(image, saliency, network);
  throw wrong_model(network, "matting", "slide_rim, fba");
}

Background inpaint_background(Value image, Value disparity, Value disocclusion, Value hole,
                              const NetworkChoice& network, const FillSources& sources) {
  const ImageSize size = size_of_image(image);
  const std::int64_t multiple = inpaint_reach(network).alignment;
  const Value rgbd = pad_to_multiple(ops::concat({image, disparity}, 1), multiple);
  FillSources padded = sources;
  if (padded.matte)
    padded.matte = {pad_to_multiple(padded.matte->clear, multiple),
                    pad_to_multiple(padded.matte->agreement, multiple)};
  const Value completed = crop(complete(rgbd, pad_to_multiple(hole, multiple), network, padded), size);
  const auto composite = [&](Value net, Value known) {
    const Value mixed = ops::add(known, ops::mul(disocclusion, ops::sub(net, known)));
    return select(hole, mixed, known);
  };
  const Value colour = composite(ops::slice(completed, 1, 0, 3), image);
  const Value behind = composite(ops::slice(completed, 1, 3, 4), disparity);
  return {colour, ops::minimum(behind, disparity)};
}

InpaintReach inpaint_reach(const NetworkChoice& network) {
  // Coarse network: 5×5 s2 sees 2; 3×3 at stride 2: 2 + 2; at stride 4: 8 for two layers, 4·(2+4+8+16) for
  // the dilated ones, 8 for two more; on the way up 4 and 3; and up to 3 by where a pixel falls in its cell
  // of four.
  constexpr std::int64_t kCoarse = 2 + 2 + 2 + 8 + 4 * (2 + 4 + 8 + 16) + 8 + 4 + 3 + 3;
  if (network.model == "inpaint_coarse") return {kCoarse, 4, true};
  // Attention reaches everywhere; the dilated branches of both stages reach twice the coarse network's
  // radius.
  if (network.model == "inpaint_deepfill") return {2 * kCoarse + 8, 8, false};
  return {kCoarse + 8, 8, false};  // slide_inpaint and the fill: averages of ever wider surroundings
}

}  // namespace slide::graphs
