#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "graphs/layering.h"
#include "graphs/windows.h"
#include "runtime/cpu.h"
#include "runtime/graph.h"
#include "runtime/plan.h"
#include "runtime/run.h"
#include "runtime/weights.h"

namespace slide::graphs {

/// A network by its name in the catalogue, and its weights. No weights: the network is not used.
struct NetworkChoice {
  std::string model;
  const WeightSource* weights = nullptr;  ///< must outlive the use
  std::int64_t side = 0;                  ///< pixels that a depth network works at: depth_side(); 0: its own
  [[nodiscard]] bool chosen() const noexcept { return weights != nullptr; }
};

/// The networks a 3D photo is made with.
struct SlideModels {
  NetworkChoice depth;  ///< slide_depth, depth_anything_v2_vits (_vitb, _vitl), midas_v21, midas_v21_small
  NetworkChoice
      inpaint;  ///< inpaint_coarse, inpaint_deepfill, slide_inpaint; none: the depth-aware fill alone
  NetworkChoice saliency;  ///< u2net, u2netp, slide_matte: a soft matte of the salient subject
  NetworkChoice matting;   ///< slide_rim, fba: refines the saliency network's matte
};

/// Whether a matte of the salient subject takes part: where disparity jumps, in the visibility, the colours
/// of both layers and the inpainting (SubjectRim of graphs/subject.h).
enum class MatteUse {
  kNever,
  kAuto,    ///< the saliency network runs, and its matte is used if something stands out: see SalientSubject
  kAlways,  ///< the matte is used whatever it shows
};

/// What a given depth map's edges are like. Soft ones are brought onto the photo's by sharpen_edges(), as a
/// network's are.
enum class DepthEdges {
  kSharp,
  kSoft,
  kAuto,  ///< has_soft_edges() of graphs/edges.h decides
};

/// What is known before the networks run.
struct SlideInput {
  Tensor image;      ///< 1×3×H×W, F32, [0, 1]
  Tensor disparity;  ///< 1×1×H×W in any range, larger is nearer; empty: the depth network estimates it
  Tensor matte;      ///< 1×1×H×W in [0, 1]; empty: see MatteUse
};

/// One line on the whole way: the stage, how far it is (0 to 1), and the node that runs next. False cancels.
using StageCallback = std::function<bool(const std::string& stage, double part, std::string_view node)>;

struct SlideOptions {
  LayeringParams layering;
  MatteUse matte = MatteUse::kNever;
  DepthEdges depth_edges = DepthEdges::kSharp;
  bool whole_image = false;      ///< inpaint the whole image in one piece instead of the windows that need it
  std::size_t memory_limit = 0;  ///< bytes for one stage's plan; 0: no limit
  Isa isa = active_isa();
  Precision precision = Precision::kFp32;  ///< of the networks: as in PlanOptions
  double error_budget = 0;                 ///< of each network: as in PlanOptions
  StageCallback progress;
};

/// What one stage took.
struct StageReport {
  std::string name;            ///< "depth", "saliency", "matting", "subject", "layering", "inpainting"
  double seconds = 0;          ///< planning and weights included
  double preparing = 0;        ///< of these: graph, plan and weights
  bool reused = false;         ///< all of it was prepared for an earlier photo (graphs/pipeline.h)
  double gflop = 0;            ///< of the definition, 2 a multiply-accumulate
  std::size_t memory = 0;      ///< bytes of the largest plan
  double predicted_error = 0;  ///< of a network's outputs (Plan); the largest plan's
  int bf16_layers = 0;         ///< computed in that precision, of the last plan
  int int8_layers = 0;
};

/// What was modelled and what was skipped, with the numbers.
struct SlideReport {
  Layering layering{};
  std::vector<StageReport> stages;
  bool relief = true;            ///< false: the disparity is flat, the scene is one layer
  double depth_jump_pixels = 0;  ///< of a given map: find_jumps(); 0 of a network's
  bool depth_sharpened = false;  ///< a given map's edges were soft
  bool matte_used = false;
  bool matte_in_fill = false;   ///< it also says what the fill takes for background
  bool matte_refined = false;   ///< the matting network refined the saliency network's
  double matte_coverage = 0;    ///< fraction of pixels with a matte above one half, where there is one
  double hole_fraction = 0;     ///< of the image's pixels
  std::vector<Window> windows;  ///< what was inpainted
  bool windows_exact = true;    ///< the windows hold all that the network's results depend on
  double window_fraction = 0;   ///< their area over the image's
  std::string inpainting;       ///< the network, "fill", or "none" with the reason
};

/// The layers of a 3D photo and the maps they come from, all F32; maps are 1×1×H×W in [0, 1].
struct SlideLayers {
  Tensor image;                 ///< I, 1×3×H×W
  Tensor disparity;             ///< D
  Tensor conditioned;           ///< D1, the foreground's geometry
  Tensor visibility;            ///< A, or A' with a matte
  Tensor disocclusion;          ///< S
  Tensor occlusion;             ///< S_hat
  Tensor hole;                  ///< H
  Tensor matte;                 ///< M; empty if none was used
  Tensor front_image;           ///< the front layer's colours: I, in the rim of a matte's subject its own
  Tensor background_image;      ///< I_bg; empty if one layer is enough
  Tensor background_disparity;  ///< D_bg <= D1; empty likewise
  SlideReport report;
  [[nodiscard]] bool has_background() const noexcept { return !background_image.empty(); }
};

/// Makes the two layers from a photo: depth, matte if asked for, soft layering, and the inpainted background
/// where the camera path can uncover it. A scene without relief or without a hole is one layer, and nothing
/// is inpainted. Throws Error(kUsage) for parameters and sizes out of range, Error(kBadInput) for NaN or
/// infinite values in a given map (naming the first such pixel), Error(kBadWeights), Error(kOutOfMemory)
/// before a stage that is over the limit, Error(kInternal) if a network's output is not finite,
/// Error(kCancelled).
[[nodiscard]] SlideLayers make_layers(const SlideInput& input, const SlideModels& models,
                                      const SlideOptions& options);

/// A stage that is planned and not run.
struct PlannedStage {
  StageReport report;            ///< no seconds
  std::unique_ptr<Graph> graph;  ///< fused
  Plan plan;
};

/// Plans without running: every stage for an image of that size, inpainting the whole of it (the windows,
/// which depend on the photo, need no more). What is known of the input decides which stages there are.
[[nodiscard]] std::vector<PlannedStage> plan_layers(std::int64_t height, std::int64_t width,
                                                    const SlideModels& models, const SlideInput& known,
                                                    const SlideOptions& options);

/// The whole as one graph, as the paper has it: from a photo 1×3×H×W to both layers in one pass over each
/// network. make_layers() gives the same, stage by stage, with what the scene does not need left out. `matte`
/// counts as given by the user.
struct SlideGraph {
  Value disparity;
  LayeringMaps maps;
  Value front_image;
  Value background_image;
  Value background_disparity;
};
SlideGraph slide_graph(Value image, const SlideModels& models, const Layering& layering,
                       std::optional<Value> matte = std::nullopt);

/// The weights of slide_graph()'s networks as one source. The models must outlive it.
[[nodiscard]] std::unique_ptr<WeightSource> slide_weights(const SlideModels& models);

}  // namespace slide::graphs
