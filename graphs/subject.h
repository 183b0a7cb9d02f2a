#pragma once

#include "graphs/layering.h"
#include "runtime/graph.h"

namespace slide::graphs {

/// What a matte says where it and the disparity agree that its subject stands before what is around. Maps are
/// 1×1×H×W, in [0, 1].
struct SubjectRim {
  Value agreement;  ///< e: how far the matte is followed; 0 away from the subject's outline
  Value moves;      ///< the same for pixels in the subject's layer, 0 for others
  Value disparity;  ///< D with its jump at the outline
  Value opaque;     ///< the same with the jump where the subject begins to be opaque
  Value front;      ///< the photo with the subject's own colours in the rim, 1×3×H×W
  Value behind;     ///< the photo with the background's own colours in the rim, 1×3×H×W
  Value clear;      ///< how far `behind` shows the background: a weight for the fill
};

/// The rim of a subject. With W the longer side, r = round(W/60) pixels and M the matte:
///   1. The subject's disparity n and that of what is around, f, are continued into the rim by
///      push_pull_fill() from pixels with M > 0.95 (for f: M < 0.05) that have no others within r pixels;
///      others of that kind count 1e-8.
///   2. Agreement, within r pixels of the rim, which is where 4·M·(1 - M) or M's range over 3×3 pixels is
///      above 0.1 (elsewhere 0), with d the mean of |[D > (n + f)/2] - [M > 1/2]| over about 2r + 1 pixels:
///        e = smoothstep(n - f, 0.06, 0.12) · (1 - smoothstep(d, 0.25, 0.4)).
///      So misplaced edges of either are put up with, not that both show different things, nor that the
///      subject is behind.
///   3. The subject's layer is what lies within round(W/160) pixels of M > 0.02, so that hair and the gaps in
///      it move together. There D becomes max(D, n), elsewhere min(D, f); `opaque` is the same with M > 0.98
///      in place of that layer.
///   4. F by foreground_colours() becomes the colour in front, and (I - M·F) / (1 - M) that behind where
///      M < 0.9.
/// All by the part e: 0 leaves D and I as they are.
/// @param image  1×3×H×W in [0, 1];  @param disparity, matte  1×1×H×W in [0, 1]
SubjectRim find_subject(Value image, Value disparity, Value matte);

}  // namespace slide::graphs
