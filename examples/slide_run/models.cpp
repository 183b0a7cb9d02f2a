#include "examples/slide_run/models.h"

namespace slide::run {

Models::Models(const Options& o) {
  if (o.depth.empty()) choices_.depth = files_.open(o.depth_weights, o.depth_model, "slide_depth", "depth");
  // The depth-aware fill alone is the default: the network inside this program is not better yet
  // (weights/README.md).
  if (!o.inpaint_weights.empty() || !o.inpaint_model.empty())
    choices_.inpaint = files_.open(o.inpaint_weights, o.inpaint_model, "slide_inpaint", "inpaint");
  if (o.matte == "auto") {
    choices_.saliency = files_.open(o.saliency_weights, o.saliency_model, "slide_matte", "saliency");
    choices_.matting = files_.open(o.matting_weights, o.matting_model, "fba", "matting");
  }
}

}  // namespace slide::run
