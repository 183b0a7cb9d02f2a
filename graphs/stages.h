#pragma once

#include <optional>

#include "graphs/layering.h"
#include "graphs/slide.h"
#include "graphs/slide_inpaint.h"
#include "runtime/graph.h"

namespace slide::graphs {

/// The stages of a 3D photo between images: each takes and gives tensors at the photo's size and hides what
/// its networks want (their sizes, ranges and layouts).

/// The side that a depth network's picture is brought to, as its authors do: of Depth Anything V2 the shorter
/// one, of the others the longer one. The network's `side`, or where that is 0 what its authors work at.
/// Throws Error(kUsage) if the model is no depth network, or cannot work at that side: it is no multiple of
/// what the network needs.
[[nodiscard]] std::int64_t depth_side(const NetworkChoice& network);

/// D: the depth network's disparity, min-max normalised; 0 everywhere if there is no relief. MiDaS's is
/// enlarged bicubically and Depth Anything V2's bilinearly as their authors do, slide_depth's by
/// ops::guided_upsample with the photo as guide, which brings its edges onto the photo's, within the range of
/// the 3×3 small pixels around. Then sharpen_edges().
/// @param image  1×3×H×W in [0, 1];  @return 1×1×H×W in [0, 1]
/// Throws Error(kUsage) as depth_side() does.
Value estimate_disparity(Value image, const NetworkChoice& network);

/// M: the saliency network's map at the photo's size. U²-Net's is computed at 320×320, min-max normalised and
/// enlarged bilinearly as the authors do; slide_matte's is computed at 384 and 288 pixels on the longer
/// side, M = M384 + smoothstep(mean of M288, 0.25, 0.4)·(M288 - M384), and enlarged by ops::guided_upsample.
/// @param image  1×3×H×W in [0, 1];  @return 1×1×H×W in [0, 1]
Value estimate_matte(Value image, const NetworkChoice& network);

/// The two sure regions of a soft map: two_chan_trimap of FbaInputs. Surely background is what lies farther
/// than r from every pixel with M > 0.1, surely foreground what lies farther than r from every pixel with M
/// <= 0.9; r = max(2, longer side / 100 rounded) pixels. Beyond the image's border there are no pixels: a
/// subject that the border cuts stays sure up to it.
/// @param saliency  M, 1×1×H×W in [0, 1];  @return 1×2×H×W of zeros and ones: background, foreground
Value trimap(Value saliency);

/// trimap_transformed of FbaInputs (MarcoForte/FBA_Matting networks/transforms.py): exp(-d²/(2·(c·320)²)) for
/// c = 0.02, 0.08, 0.16, d the distance to the nearest pixel of the region; first of the background, then of
/// the foreground. Zeros for a region without pixels.
/// @param two_chan_trimap  1×2×H×W of zeros and ones;  @return 1×6×H×W
Value trimap_transform(Value two_chan_trimap);

/// The saliency network's map refined at the photo's size. By slide_rim, at up to 1536 pixels on the longer
/// side: larger photos are reduced to that, and the result enlarged by ops::guided_upsample. Or by FBA matting:
/// alpha, and exactly 0 and 1 in the sure regions of trimap(), as the authors' demo has it. Sides are padded to
/// multiples of 8 by the border pixel at the bottom and right, and cut again, where FBA's authors resample.
/// @param image  1×3×H×W in [0, 1];  @param saliency  1×1×H×W in [0, 1];  @return 1×1×H×W in [0, 1]
/// Throws Error(kUsage) if the model is no matting network.
Value refine_matte(Value image, Value saliency, const NetworkChoice& network);

/// The inpainted background.
struct Background {
  Value image;      ///< I_bg = S·net + (1 - S)·I inside H, I elsewhere
  Value disparity;  ///< D_bg, the same from D1, and never above D1
};

/// Depth-aware RGBD inpainting and the composite of docs/method.md, section 5. Sides that the network cannot take are
/// padded at the bottom and right by the border pixel, and cut again. Without a network the depth-aware fill
/// stands in for it.
/// @param image        1×3×H×W in [0, 1]: the photo, with a matte SubjectRim::behind
/// @param disparity    D1, 1×1×H×W
/// @param disocclusion S, 1×1×H×W
/// @param hole         H, 1×1×H×W
/// @param sources      for the fill and slide_inpaint, which starts from it; others see the hole alone
/// Throws Error(kUsage) if the model is no inpainting network.
Background inpaint_background(Value image, Value disparity, Value disocclusion, Value hole,
                              const NetworkChoice& network, const FillSources& sources = {});

/// How much of the surroundings an inpainting network sees.
struct InpaintReach {
  std::int64_t radius;     ///< pixels: what lies farther from a pixel does not change its result
  std::int64_t alignment;  ///< the network's stride: windows must start at its multiples
  bool exact;  ///< false: some influence has no limit, and the radius is where it has become small
};
[[nodiscard]] InpaintReach inpaint_reach(const NetworkChoice& network);

}  // namespace slide::graphs
