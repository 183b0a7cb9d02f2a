#pragma once

#include "runtime/graph.h"

namespace slide::graphs {

/// An estimated disparity whose edges are sharp and lie where the photo's are. A network's map, enlarged, has
/// ramps of several pixels at a subject's outline; drawn from aside, they smear what should be cut. With W
/// the longer side, three steps:
///   1. The median over 2·round(W/500) + 1 pixels takes away specks and the photo's texture.
///   2. Twice: with lo and hi the extremes within r = round(W/160) pixels, every pixel moves to the nearer of
///      both (contrast enhancement; Kramer and Bruckner, "Iterations of a non-linear transformation for
///      enhancement of digital images", 1975), by the part t = smoothstep(hi - lo - slope,
///      0.03, 0.06): a jump becomes steep, a slope stays what it is. slope is half of what the range within
///      3r pixels has more, at most 0.06: all of hi - lo where D is a plane, nothing beside a jump.
///   3. Over about 2·round(W/60) + 1 pixels (means are taken of cells) with extremes lo and hi, a pixel is
///   near where D > (lo + hi)/2; c_n and c_f are the mean colours of the near and of the far pixels, each
///   weighted with its t, v_n and v_f their variances, s the near ones' share of the weight. The pixel I
///   becomes hi where
///     (|I - c_f|² - |I - c_n|²) / (|c_n - c_f|² + v_n + v_f + 0.002) + 2·s - 1 ± 0.1 > 0
///   (+ where it is near already) for most of the pixels in a window as in 1, else lo; by the part t again.
///   So the jump moves onto the photo's edge where both sides differ in colour, and stays where they do not.
/// All values lie between the least and the largest D within W/60 and the windows of 1 and 2.
/// @param disparity  1×1×H×W in [0, 1];  @param image  1×3×H×W in [0, 1];  @return 1×1×H×W in [0, 1]
Value sharpen_edges(Value disparity, Value image);

}  // namespace slide::graphs
