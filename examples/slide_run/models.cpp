#include "examples/slide_run/models.h"

namespace slide::run {

Models::Models(const Options& o) {
  if (o.depth.empty() || o.depth == kDepthAuto)
    choices_.depth = files_.open(o.depth_weights, o.depth_model, "slide_depth", "depth");
  if (o.inpaint_model != kFillAlone)
    choices_.inpaint = files_.open(o.inpaint_weights, o.inpaint_model, "slide_inpaint", "inpaint");
  if (o.matte == "auto") {
    choices_.saliency = files_.open(o.saliency_weights, o.saliency_model, "slide_matte", "saliency");
    choices_.matting = files_.open(o.matting_weights, o.matting_model, "fba", "matting");
  }
}

}  // namespace slide::run
