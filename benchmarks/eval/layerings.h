#pragma once

#include "benchmarks/eval/stereo_scene.h"
#include "graphs/slide.h"
#include "render/layers.h"

namespace slide::eval {

/// Other ways to make layers of a photo than the default, to compare it with.

/// The foreground alone, opaque: what lies behind an edge is the triangles stretched across it.
[[nodiscard]] Layers single_layer(const graphs::SlideLayers& made);

/// A is 0 or 1, and so is S: in the whole hole the background is what the inpainting says.
[[nodiscard]] Layers hard_layers(const graphs::SlideLayers& made, const graphs::NetworkChoice& inpaint);

/// The background as the plainest copy there is: a run of hole pixels in a row takes over colour and
/// disparity of the farther one of the two pixels at its ends.
void copy_background(graphs::SlideLayers& made);

/// base and range such that base + range·D is closest to known values (least squares); range >= 0.
class LineFit {
 public:
  void add(double d, double value) noexcept;
  [[nodiscard]] PixelRange result() const noexcept;

 private:
  double n_ = 0, x_ = 0, y_ = 0, xx_ = 0, xy_ = 0;
};

}  // namespace slide::eval
