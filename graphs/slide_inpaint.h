#pragma once

#include <cstdint>
#include <optional>

#include "runtime/graph.h"

namespace slide::graphs {

/// Which pixels show what lies behind the hole: 1 for background, 0 for the hole and for what covers it. The
/// disparity of the hole's pixels (the front) is spread over the picture by a push-pull fill; a pixel belongs
/// to the background as far as it is behind the front: (1 - hole)·clip(16·(front - disparity), 0, 1), and at
/// least 1e-11, so that there is a fill also where nothing lies behind. With a reach, in pixels, what counts is
/// how far behind it is beside the deepest within the reach, d: clip(8·(front - disparity)/max(d, 1/16) - 1/2,
/// 0, 1), so that a subject's own relief is not taken for what it covers.
/// @param disparity  D1, 1×1×H×W in [0,1]
/// @param hole       1×1×H×W, 1 inside the hole
Value background_weight(Value disparity, Value hole, std::int64_t reach = 0);

/// Which pixels have the background's colour, whether or not they are in the hole: by where their disparity
/// lies between that of the background and what covers it nearby, w = (disparity - behind) / max(max of
/// disparity over 9×9 - behind, 1/128). All counts up to w = 0.1, nothing but 1e-11 from 0.4 on, linear
/// between. Disparity is grown and soft, so a rim of the hole is background, and some of what lies just
/// outside of it is not.
/// @param disparity  D1, 1×1×H×W in [0,1]
/// @param behind     1×1×H×W in [0,1], the background's disparity, continued by background_weight()
Value colour_weight(Value disparity, Value behind);

/// What a matte of the photo's subject tells the fill: SubjectRim of graphs/subject.h. Both 1×1×H×W in [0,1].
struct SubjectMatte {
  Value clear;      ///< how far a pixel shows the background
  Value agreement;  ///< how far the matte is followed
};

/// Where the fill may take its colours from, beside what disparity tells.
struct FillSources {
  std::optional<SubjectMatte> matte = {};
  /// Pixels beside what is no source that count little, where no matte is followed: fill_margin(). Twelve times
  /// as far is background_weight()'s reach.
  std::int64_t margin = 0;
};

/// The margin for a photo, whose size it follows: one pixel in 300 of the longer side. Beside a subject are
/// hair and pixels that are half the subject's.
/// @param photo  ...×H×W
[[nodiscard]] std::int64_t fill_margin(const Shape& photo);

/// Which part of its weight a pixel keeps: 0.05 within `margin` pixels of what is no source, `weight` below
/// 1/2, so that it counts where nothing else is near; else 1.
/// @param weight  1×1×H×W, colour_weight(), and no network's: it decides by a threshold
Value kept_beside_margin(Value weight, std::int64_t margin);

/// colour_weight() with a matte of the subject: w' = w + agreement·(clear - w), at least 1e-11: near the
/// subject the matte's outline replaces the disparity's.
/// @param weight  colour_weight(), 1×1×H×W
Value matted_weight(Value weight, const SubjectMatte& matte);

/// Texture for the unknown: what the background is beyond its own blur (deviation 1, weighted), mirrored into
/// the hole by ops::mirror_known() at the outline of `known`, times 7/4, at most 0.1 (which keeps edges out),
/// times 1 - weight. What is mirrored where jumps with the outline, everything else is continuous: an outline
/// that is not a network's is the same in every precision.
/// @param rgb     1×3×H×W in [-1,1]
/// @param weight  colour_weight(), which a network may have corrected
/// @param known   colour_weight(), as it was, with a matte matted_weight(), both off the margin
Value detail(Value rgb, Value weight, Value known);

/// The depth-aware fill: the picture, and in the hole and all that covers it the background continued
/// smoothly: colours by colour_weight(), or with a matte matted_weight(), off the margin, and with detail(),
/// disparity by background_weight(). What inpainting without a network is.
/// @param rgbd       1×4×H×W in [-1,1]; its disparity is not read
/// @param disparity  D1, 1×1×H×W in [0,1]
/// @param hole       1×1×H×W, 1 inside the hole
Value background_fill(Value rgbd, Value disparity, Value hole, const FillSources& sources = {});

/// The project's own RGBD inpainting network (weights_tools/train/inpaint_net.py): the depth-aware fill, with
/// a network that tells which pixels around the hole are background. It sees the picture, a fill by
/// colour_weight(), disparity, the background's, that weight w and the hole, and gives a change c of the log
/// odds of being background: with p = 0.35 + 0.5·w, w' = clip(2·p / (p + (1 - p)·e^-c) - 0.7, 1e-11, 1), so
/// that what is doubtful gives no colour. Zero changes nothing.
/// @param rgbd       1×4×H×W in [-1,1]; its disparity is not read; H and W multiples of 8
/// @param disparity  D1, 1×1×H×W in [0,1]
/// @param hole       1×1×H×W, 1 inside the hole
/// @return 1×4×H×W, about [-1,1], not clipped
/// Throws Error(kUsage) for other shapes.
Value slide_inpaint(Value rgbd, Value disparity, Value hole, const FillSources& sources = {});

}  // namespace slide::graphs
