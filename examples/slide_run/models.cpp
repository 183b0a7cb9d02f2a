#include "examples/slide_run/models.h"

#include "graphs/stages.h"

namespace slide::run {

namespace {

graphs::SlideModels open(const Options& o, NetworkFiles& files) {
  graphs::SlideModels models;
  if (o.depth.empty() || o.depth == kDepthAuto) {
    models.depth = files.open(o.depth_weights, o.depth_model, "slide_depth", "depth");
    models.depth.side = o.depth_size;
    if (models.depth.chosen()) (void)graphs::depth_side(models.depth);  // before any photo
  }
  if (o.inpaint_model != kFillAlone)
    models.inpaint = files.open(o.inpaint_weights, o.inpaint_model, "slide_inpaint", "inpaint");
  if (o.matte == "auto") {
    models.saliency = files.open(o.saliency_weights, o.saliency_model, "slide_matte", "saliency");
    if (o.matting_model != kMatteAsItIs)
      models.matting =
          files.open(o.matting_weights, o.matting_model, default_refiner(models.saliency), "matting");
  }
  return models;
}

}  // namespace

Models::Models(const Options& o) : pipeline_(open(o, files_), 0) {}

}  // namespace slide::run
