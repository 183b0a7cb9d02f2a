#include "graphs/slide.h"

#include <algorithm>
#include <cmath>

#include "graphs/edges.h"
#include "graphs/pipeline.h"
#include "graphs/stage.h"
#include "graphs/stages.h"
#include "graphs/subject.h"
#include "ops/normalise/normalise.h"
#include "runtime/error.h"

namespace slide::graphs {
namespace {

/// Coverage of the matte (fraction above one half) between which a salient subject stands out.
constexpr double kLeastCoverage = 0.01;
constexpr double kLargestCoverage = 0.85;

/// A subject's matte is mostly decided: this fraction of what is above 0.1 is above 0.9.
constexpr double kDecided = 0.5;

/// Names below "depth." and "inpaint.", each found in its own source.
class ScopedWeights : public WeightSource {
 public:
  explicit ScopedWeights(const SlideModels& models) : models_(models) {}
  [[nodiscard]] std::string description() const override { return "the weights of the whole graph"; }
  [[nodiscard]] std::optional<Tensor> find(std::string_view name, const Shape& wanted) const override {
    for (const auto& [prefix, source] : sources())
      if (source != nullptr && name.starts_with(prefix))
        return source->find(name.substr(prefix.size()), wanted);
    return std::nullopt;
  }
  [[nodiscard]] std::vector<std::string> names() const override {
    std::vector<std::string> all;
    for (const auto& [prefix, source] : sources())
      if (source != nullptr)
        for (const std::string& name : source->names()) all.push_back(std::string(prefix) + name);
    return all;
  }

 private:
  [[nodiscard]] std::array<std::pair<std::string_view, const WeightSource*>, 2> sources() const {
    return {{{"depth.", models_.depth.weights}, {"inpaint.", models_.inpaint.weights}}};
  }
  SlideModels models_;
};

/// The stages of the networks, for images of a shape: one builder for running and for planning.
BuildStage depth_builder(const Shape& image, const NetworkChoice& network) {
  return [=](Graph& g) { g.output("D", estimate_disparity(g.input("image", image), network)); };
}
BuildStage saliency_builder(const Shape& image, const NetworkChoice& network) {
  return [=](Graph& g) { g.output("M", estimate_matte(g.input("image", image), network)); };
}
BuildStage matting_builder(const Shape& map, const NetworkChoice& network) {
  return [=](Graph& g) {
    g.output("M", refine_matte(g.input("image", map.with(1, 3)), g.input("saliency", map), network));
  };
}

void require_map(const std::string& what, const Tensor& map, const Shape& image) {
  const Shape wanted = image.with(1, 1);
  if (map.shape() != wanted || map.dtype() != DType::kF32)
    throw Error(ErrorKind::kUsage, "the " + what + " has the shape " + map.shape().text() +
                                       ", the image needs " + wanted.text());
}

void require_finite(const std::string& what, const Tensor& map, ErrorKind kind) {
  const std::span<const float> values = map.data<float>();
  const auto bad = std::find_if(values.begin(), values.end(), [](float v) { return !std::isfinite(v); });
  if (bad == values.end()) return;
  const std::int64_t at = bad - values.begin();
  const std::int64_t width = map.shape()[-1];
  throw Error(kind, "the " + what + " is not finite at pixel (" + std::to_string(at % width) + ", " +
                        std::to_string(at / width) + ")");
}

void check_input(const SlideInput& input) {
  const Shape& s = input.image.shape();
  if (input.image.dtype() != DType::kF32 || s.rank() != 4 || s[0] != 1 || s[1] != 3 || s.count() == 0)
    throw Error(ErrorKind::kUsage, "a photo is a float32 tensor of 1x3xHxW, not " + s.text());
  require_finite("photo", input.image, ErrorKind::kBadInput);
  if (!input.disparity.empty()) {
    require_map("depth map", input.disparity, s);
    require_finite("depth map", input.disparity, ErrorKind::kBadInput);
  }
  if (!input.matte.empty()) {
    require_map("matte", input.matte, s);
    require_finite("matte", input.matte, ErrorKind::kBadInput);
  }
}

double fraction_above(const Tensor& map, float threshold) {
  const std::span<const float> values = map.data<float>();
  const auto above = std::count_if(values.begin(), values.end(), [&](float v) { return v > threshold; });
  return static_cast<double>(above) / static_cast<double>(values.size());
}

/// D by the network.
Tensor estimate(const StageContext& context, const Tensor& image, StageReport& report) {
  Stage stage("depth", context, context.models.depth);
  stage.run({{"image", image}}, depth_builder(image.shape(), context.models.depth));
  report = stage.report();
  Tensor disparity = stage.take("D");
  require_finite("network's disparity", disparity, ErrorKind::kInternal);
  return disparity;
}

bool is_sharpened(const Tensor& map, const SlideOptions& options) {
  return options.depth_edges == DepthEdges::kSoft ||
         (options.depth_edges == DepthEdges::kAuto && has_soft_edges(map));
}

/// D of a given map.
BuildStage given_builder(const Shape& map, bool sharpened) {
  return [=](Graph& g) {
    const Value d = ops::min_max_normalise(g.input("disparity", map));
    g.output("D", sharpened ? sharpen_edges(d, g.input("image", map.with(1, 3))) : d);
  };
}

/// D: the user's map, normalised to [0, 1].
Tensor take_given(const SlideInput& input, const StageContext& context, SlideReport& report) {
  report.depth_jump_pixels = find_jumps(input.disparity).pixels;
  report.depth_sharpened = is_sharpened(input.disparity, context.options);
  NamedTensors inputs = {{"disparity", input.disparity}};
  if (report.depth_sharpened) inputs["image"] = input.image;
  Stage stage("depth", context);
  stage.run(inputs, given_builder(input.disparity.shape(), report.depth_sharpened));
  report.stages.push_back(stage.report());
  return stage.take("D");
}

void require_depth_network(const SlideModels& models) {
  if (!models.depth.chosen())
    throw Error(ErrorKind::kUsage, "there is neither a depth map nor a depth network",
                "give --depth FILE, or --depth-weights FILE");
}

void find_disparity(const SlideInput& input, const StageContext& context, SlideLayers& out) {
  const bool given = !input.disparity.empty();
  if (!given) require_depth_network(context.models);
  out.disparity = given ? take_given(input, context, out.report)
                        : estimate(context, input.image, out.report.stages.emplace_back());
  out.report.relief = max_abs(out.disparity) > 0;
}

bool stands_out(const Tensor& matte, double coverage) {
  if (coverage < kLeastCoverage || coverage > kLargestCoverage) return false;
  return fraction_above(matte, 0.9F) > kDecided * fraction_above(matte, 0.1F);
}

/// The saliency network's matte refined by the matting network.
void refine(const StageContext& context, Tensor& matte, SlideLayers& out) {
  const NetworkChoice& network = context.models.matting;
  Stage stage("matting", context, network);
  stage.run({{"image", out.image}, {"saliency", matte}}, matting_builder(matte.shape(), network));
  matte = stage.take("M");
  require_finite("refined matte", matte, ErrorKind::kInternal);
  out.report.stages.push_back(stage.report());
  out.report.matte_refined = true;
  out.report.matte_coverage = fraction_above(matte, 0.5F);
}

/// M: the user's, or the saliency network's if it is asked for and (kAuto) shows a subject, refined if there
/// is a matting network.
void find_matte(const SlideInput& input, const StageContext& context, SlideLayers& out) {
  const SlideModels& models = context.models;
  Tensor matte = input.matte;
  if (matte.empty()) {
    if (context.options.matte == MatteUse::kNever) return;
    if (!models.saliency.chosen())
      throw Error(ErrorKind::kUsage, "a matte is asked for, and there is no saliency network",
                  "give --matte FILE, or --saliency-weights FILE");
    Stage stage("saliency", context, models.saliency);
    stage.run({{"image", input.image}}, saliency_builder(input.image.shape(), models.saliency));
    matte = stage.take("M");
    require_finite("network's matte", matte, ErrorKind::kInternal);
    out.report.stages.push_back(stage.report());
  }
  out.report.matte_coverage = fraction_above(matte, 0.5F);
  const bool forced = !input.matte.empty() || context.options.matte == MatteUse::kAlways;
  if (!forced && !stands_out(matte, out.report.matte_coverage)) return;
  if (input.matte.empty() && models.matting.chosen()) refine(context, matte, out);
  out.matte = matte;
  out.report.matte_used = true;
}

void output_maps(Graph& g, const LayeringMaps& maps) {
  g.output("D1", maps.disparity);
  g.output("A", maps.visibility);
  g.output("S", maps.disocclusion);
  g.output("S_hat", maps.occlusion);
  g.output("H", maps.hole);
}

/// What the later stages take from find_subject() beside disparity and colours.
struct SubjectMaps {
  Tensor agreement, moves, opaque, behind, clear;
};

void output_subject(Graph& g, const SubjectRim& rim) {
  g.output("e", rim.agreement);
  g.output("p", rim.moves);
  g.output("D'", rim.disparity);
  g.output("opaque", rim.opaque);
  g.output("F", rim.front);
  g.output("B", rim.behind);
  g.output("clear", rim.clear);
}

SubjectRim subject_graph(Graph& g, const Shape& map) {
  const SubjectRim rim = find_subject(g.input("I", map.with(1, 3)), g.input("D", map), g.input("M", map));
  output_subject(g, rim);
  return rim;
}

/// Follows the matte, if there is one: disparity and the colours in front change.
std::optional<SubjectMaps> follow_matte(const StageContext& context, SlideLayers& out) {
  out.front_image = out.image;
  if (out.matte.empty()) return std::nullopt;
  Stage stage("subject", context);
  stage.run({{"I", out.image}, {"D", out.disparity}, {"M", out.matte}},
            [&](Graph& g) { (void)subject_graph(g, out.matte.shape()); });
  out.disparity = stage.take("D'");
  out.front_image = stage.take("F");
  out.report.stages.push_back(stage.report());
  return SubjectMaps{stage.take("e"), stage.take("p"), stage.take("opaque"), stage.take("B"),
                     stage.take("clear")};
}

void layering_graph(Graph& g, const Shape& map, const Layering& layering, bool matte) {
  std::optional<FollowedMatte> followed;
  if (matte) followed = {g.input("M", map), g.input("p", map), g.input("opaque", map)};
  output_maps(g, soft_layering(g.input("D", map), layering, followed));
}

void split_layers(const std::optional<SubjectMaps>& subject, const StageContext& context, SlideLayers& out) {
  NamedTensors inputs = {{"D", out.disparity}};
  if (subject) {
    inputs["M"] = out.matte;
    inputs["p"] = subject->moves;
    inputs["opaque"] = subject->opaque;
  }
  Stage stage("layering", context);
  stage.run(inputs, [&](Graph& g) {
    layering_graph(g, out.disparity.shape(), out.report.layering, subject.has_value());
  });
  out.conditioned = stage.take("D1");
  out.visibility = stage.take("A");
  out.disocclusion = stage.take("S");
  out.occlusion = stage.take("S_hat");
  out.hole = stage.take("H");
  out.report.stages.push_back(stage.report());
  out.report.hole_fraction = fraction_above(out.hole, 0.5F);
}

/// Whether the fill follows a matte: other networks see the hole alone.
bool fills(const NetworkChoice& network) { return !network.chosen() || network.model == "slide_inpaint"; }

/// @param map  the shape of the part of a photo, whose margin is `margin`
Background background_graph(Graph& g, const Shape& map, std::int64_t margin, const NetworkChoice& network,
                            bool with_matte) {
  FillSources sources{.margin = margin};
  if (with_matte) sources.matte = {g.input("clear", map), g.input("e", map)};
  const Background background = inpaint_background(g.input("I", map.with(1, 3)), g.input("D1", map),
                                                   g.input("S", map), g.input("H", map), network, sources);
  g.output("I_bg", background.image);
  g.output("D_bg", background.disparity);
  return background;
}

/// I_bg and D_bg: the photo itself, and in every window what the network makes of it.
void inpaint_windows(const std::optional<SubjectMaps>& subject, const StageContext& context,
                     SlideLayers& out) {
  const SlideModels& models = context.models;
  const SlideOptions& options = context.options;
  const Shape& shape = out.hole.shape();
  const InpaintReach reach = inpaint_reach(models.inpaint);
  const std::int64_t margin = options.whole_image ? std::max(shape[2], shape[3]) : reach.radius;
  out.report.windows = hole_windows(out.hole, margin, reach.alignment);
  out.report.windows_exact = reach.exact || options.whole_image;
  const Tensor& behind = subject ? subject->behind : out.image;
  out.background_image = behind.clone();
  out.background_disparity = out.conditioned.clone();
  const bool matte = subject && fills(models.inpaint);
  out.report.matte_in_fill = matte;
  StageReport total;
  total.name = "inpainting";
  double area = 0;
  for (const Window& w : out.report.windows) area += static_cast<double>(w.area());
  double done = 0;
  for (const Window& w : out.report.windows) {
    NamedTensors inputs = {{"I", cut(behind, w)},
                           {"D1", cut(out.conditioned, w)},
                           {"S", cut(out.disocclusion, w)},
                           {"H", cut(out.hole, w)}};
    if (matte) {
      inputs["clear"] = cut(subject->clear, w);
      inputs["e"] = cut(subject->agreement, w);
    }
    const std::int64_t fill = fill_margin(shape);
    const Shape part{1, 1, w.height(), w.width()};
    Stage stage(total.name, context, models.inpaint);
    stage.run(inputs, [&](Graph& g) { background_graph(g, part, fill, models.inpaint, matte); }, fill,
              {done / area, static_cast<double>(w.area()) / area});
    paste(stage.take("I_bg"), w, out.background_image);
    paste(stage.take("D_bg"), w, out.background_disparity);
    done += static_cast<double>(w.area());
    total.seconds += stage.report().seconds;
    total.preparing += stage.report().preparing;
    total.gflop += stage.report().gflop;
    total.memory = std::max(total.memory, stage.report().memory);
    total.predicted_error = std::max(total.predicted_error, stage.report().predicted_error);
    total.bf16_layers = stage.report().bf16_layers;
    total.int8_layers = stage.report().int8_layers;
  }
  require_finite("inpainted background", out.background_image, ErrorKind::kInternal);
  require_finite("inpainted disparity", out.background_disparity, ErrorKind::kInternal);
  out.report.stages.push_back(total);
  out.report.window_fraction = area / static_cast<double>(shape[2] * shape[3]);
  out.report.inpainting = models.inpaint.chosen() ? models.inpaint.model : "fill";
}

}  // namespace

SlideLayers make_layers(const SlideInput& input, const SlideModels& models, const SlideOptions& options) {
  return Pipeline(models, 0).make_layers(input, options);
}

std::vector<PlannedStage> plan_layers(std::int64_t height, std::int64_t width, const SlideModels& models,
                                      const SlideInput& known, const SlideOptions& options) {
  const Shape map{1, 1, height, width};
  const Shape image = map.with(1, 3);
  std::vector<PlannedStage> stages;
  const auto plan = [&](const char* name, const BuildStage& build, const NetworkChoice& network = {}) {
    stages.push_back(plan_stage(name, options, build, network));
  };
  if (known.disparity.empty() && models.depth.chosen())
    plan("depth", depth_builder(image, models.depth), models.depth);
  if (!known.disparity.empty() && is_sharpened(known.disparity, options))
    plan("depth", given_builder(map, true));
  if (known.matte.empty() && options.matte != MatteUse::kNever && models.saliency.chosen()) {
    plan("saliency", saliency_builder(image, models.saliency), models.saliency);
    if (models.matting.chosen()) plan("matting", matting_builder(map, models.matting), models.matting);
  }
  const bool matte = !known.matte.empty() || options.matte != MatteUse::kNever;
  if (matte) plan("subject", [&](Graph& g) { (void)subject_graph(g, map); });
  plan("layering", [&](Graph& g) { layering_graph(g, map, resolve(options.layering), matte); });
  plan(
      "inpainting",
      [&](Graph& g) {
        background_graph(g, map, fill_margin(map), models.inpaint, matte && fills(models.inpaint));
      },
      models.inpaint);
  return stages;
}

SlideGraph slide_graph(Value image, const SlideModels& models, const Layering& layering,
                       std::optional<Value> matte) {
  Graph& g = image.graph();
  const auto disparity = [&] {
    const auto scope = g.scope("depth");
    return estimate_disparity(image, models.depth);
  }();
  std::optional<SubjectRim> rim;
  std::optional<FollowedMatte> followed;
  FillSources sources{.margin = fill_margin(image.shape())};
  if (matte) {
    rim = find_subject(image, disparity, *matte);
    followed = {*matte, rim->moves, rim->opaque};
    if (fills(models.inpaint)) sources.matte = {rim->clear, rim->agreement};
  }
  const Value d = rim ? rim->disparity : disparity;
  const LayeringMaps maps = soft_layering(d, layering, followed);
  const auto scope = g.scope("inpaint");
  const Background background = inpaint_background(rim ? rim->behind : image, maps.disparity,
                                                   maps.disocclusion, maps.hole, models.inpaint, sources);
  return {d, maps, rim ? rim->front : image, background.image, background.disparity};
}

Pipeline::Pipeline(const SlideModels& models, std::size_t keep)
    : models_(models), prepared_(std::make_unique<PreparedStages>(keep)) {}
Pipeline::~Pipeline() = default;
Pipeline::Pipeline(Pipeline&&) noexcept = default;
Pipeline& Pipeline::operator=(Pipeline&&) noexcept = default;

void Pipeline::keep(std::size_t bytes) { prepared_->allow(bytes); }
std::size_t Pipeline::kept_bytes() const noexcept { return prepared_->kept_bytes(); }
void Pipeline::release_workspace() noexcept { prepared_->release_workspace(); }

SlideLayers Pipeline::make_layers(const SlideInput& input, const SlideOptions& options) {
  check_input(input);
  const StageContext context{models_, options, *prepared_};
  SlideLayers out;
  out.image = input.image;
  out.report.layering = resolve(options.layering);
  find_disparity(input, context, out);
  if (out.report.relief) find_matte(input, context, out);
  const std::optional<SubjectMaps> subject = follow_matte(context, out);
  split_layers(subject, context, out);
  if (!out.report.relief)
    out.report.inpainting = "none: the scene has no relief";
  else if (out.report.hole_fraction == 0)
    out.report.inpainting = "none: nothing comes into view";
  else
    inpaint_windows(subject, context, out);
  release_workspace();
  return out;
}

Tensor Pipeline::disparity(const Tensor& image, const SlideOptions& options, StageReport* report) {
  check_input({image, {}, {}});
  require_depth_network(models_);
  StageReport took;
  Tensor result = estimate({models_, options, *prepared_}, image, took);
  if (report != nullptr) *report = took;
  return result;
}

void Pipeline::prepare_disparity(std::int64_t height, std::int64_t width, const SlideOptions& options) {
  require_depth_network(models_);
  const Shape image{1, 3, height, width};
  const StageContext context{models_, options, *prepared_};
  Stage("depth", context, models_.depth)
      .prepare({{"image", Tensor::view(DType::kF32, image, nullptr)}}, depth_builder(image, models_.depth));
}

std::unique_ptr<WeightSource> slide_weights(const SlideModels& models) {
  return std::make_unique<ScopedWeights>(models);
}

}  // namespace slide::graphs
