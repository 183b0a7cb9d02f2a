#include "examples/slide_run/models.h"

#include "graphs/stages.h"

namespace slide::run {

Models::Models(const Options& o) {
  if (o.depth.empty() || o.depth == kDepthAuto) {
    choices_.depth = files_.open(o.depth_weights, o.depth_model, "slide_depth", "depth");
    choices_.depth.side = o.depth_size;
    if (choices_.depth.chosen()) (void)graphs::depth_side(choices_.depth);  // before any photo
  }
  if (o.inpaint_model != kFillAlone)
    choices_.inpaint = files_.open(o.inpaint_weights, o.inpaint_model, "slide_inpaint", "inpaint");
  if (o.matte == "auto") {
    choices_.saliency = files_.open(o.saliency_weights, o.saliency_model, "slide_matte", "saliency");
    choices_.matting = files_.open(o.matting_weights, o.matting_model, "fba", "matting");
  }
}

}  // namespace slide::run
