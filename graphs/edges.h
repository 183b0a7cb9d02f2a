#pragma once

#include <cstdint>

#include "runtime/graph.h"
#include "runtime/tensor.h"

namespace slide::graphs {

/// An estimated disparity whose edges are sharp and lie where the photo's are. A network's map, enlarged, has
/// ramps of several pixels at a subject's outline; drawn from aside, they smear what should be cut. With W
/// the longer side, four steps:
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
///   4. A far pixel within round(W/250) pixels of the near side becomes near if its colour is not the
///   background's, |I - c_f|² > 9·(v_f + 0.002) with c_f and v_f of the far pixels beyond that reach, and so
///   are most in a window as in 1; by the part t. Outlines drawn in a colour of their own (a bowl's rim) and
///   mixed pixels go with the subject as a whole.
/// All values lie between the least and the largest D within twice W/60 and the windows of 1 and 2.
/// @param disparity  1×1×H×W in [0, 1];  @param image  1×3×H×W in [0, 1];  @return 1×1×H×W in [0, 1]
Value sharpen_edges(Value disparity, Value image);

/// How a map jumps from near to far.
struct Jumps {
  double pixels;       ///< that half of the large jumps take at most; 0 where there are none
  std::int64_t count;  ///< of large jumps
};

/// Looks along at most 512 rows and 512 columns for the steepest step between two neighbours within
/// max(3, round(W/160)) pixels, W the longer side, where the range over these pixels is at least 0.08 of the map's: a
/// large jump. It takes range over step pixels: 1 where neighbours of the photo are at both ends of it.
/// @param disparity  1×1×H×W, F32, finite, in any range
[[nodiscard]] Jumps find_jumps(const Tensor& disparity);

/// Whether a map is to be sharpened: it has at least 50 large jumps, and they take more than max(3, W/400)
/// pixels. Measured maps of stereo scenes (450 to 720 pixels) have 1.0 to 1.1; networks' maps of 1,536 pixels
/// have 4.2 to 7.6 (the limit is 3.8). Below 3 pixels the steps cost thin things more than they give outlines.
[[nodiscard]] bool has_soft_edges(const Tensor& disparity);

}  // namespace slide::graphs
