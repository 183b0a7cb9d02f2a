#include "graphs/slide.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "graphs/stages.h"
#include "graphs/subject.h"
#include "ops/fusion/fusion.h"
#include "ops/normalise/normalise.h"
#include "runtime/error.h"
#include "runtime/fast_executor.h"

namespace slide::graphs {
namespace {

/// Coverage of the matte (fraction above one half) between which a salient subject stands out.
constexpr double kLeastCoverage = 0.01;
constexpr double kLargestCoverage = 0.85;

/// A subject's matte is mostly decided: this fraction of what is above 0.1 is above 0.9.
constexpr double kDecided = 0.5;

const WeightMap kNoWeights("a stage without weights");

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

/// One stage: a graph, its weights, and what its run took.
class Stage {
 public:
  Stage(std::string name, const SlideOptions& options) : options_(options) { report_.name = std::move(name); }
  [[nodiscard]] Graph& graph() noexcept { return *graph_; }

  /// Memory and arithmetic, without running. The stage is used up. `network`: it has one.
  [[nodiscard]] PlannedStage plan(const NetworkChoice& network = {}) && {
    graph_ = ops::fuse(*graph_);
    const bool chosen = network.chosen();
    Plan plan = make_plan(*graph_, {.isa = options_.isa,
                                    .precision = chosen ? options_.precision : Precision::kFp32,
                                    .error_budget = chosen ? options_.error_budget : 0,
                                    .calibration = chosen ? network.weights->calibration() : nullptr,
                                    .weights = chosen ? network.weights : nullptr});
    count(plan);
    return {report_, std::move(graph_), std::move(plan)};
  }

  /// Fuses and runs the graph; `first` and `part` say which part of the stage's way this run is.
  void run(const WeightSource& weights, const NamedTensors& inputs, double first = 0, double part = 1) {
    const auto start = std::chrono::steady_clock::now();
    graph_ = ops::fuse(*graph_);
    const bool network = &weights != &kNoWeights;
    executor_.emplace(*graph_, weights,
                      FastOptions{.isa = options_.isa,
                                  .memory_limit = options_.memory_limit,
                                  .precision = network ? options_.precision : Precision::kFp32,
                                  .error_budget = network ? options_.error_budget : 0});
    count(executor_->plan());
    RunOptions run_options;
    if (options_.progress)
      run_options.progress = [&](const Progress& p) {
        return options_.progress(report_.name, first + part * p.done / std::max(1, p.total), p.node);
      };
    executor_->run(inputs, run_options);
    report_.seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }

  /// A copy of an output: the arena goes with the stage.
  [[nodiscard]] Tensor take(std::string_view output) const { return executor_->tensor(output).clone(); }
  [[nodiscard]] const StageReport& report() const noexcept { return report_; }

 private:
  void count(const Plan& plan) {
    report_.memory = plan.memory_bytes();
    report_.predicted_error = plan.predicted_error;
    for (const PlanStep& step : plan.steps) {
      if (step.kernel->precision() == Precision::kBf16) ++report_.bf16_layers;
      if (step.kernel->precision() == Precision::kInt8) ++report_.int8_layers;
    }
    for (const PlanStep& step : plan.steps) {
      const Node& node = graph_->node(step.node);
      std::vector<Shape> shapes;
      for (const int j : node.inputs) shapes.push_back(graph_->node(j).shape);
      report_.gflop += 2e-9 * node.op->macs(shapes, node.shape);
    }
  }

  const SlideOptions& options_;
  StageReport report_;
  std::unique_ptr<Graph> graph_ = std::make_unique<Graph>();
  std::optional<FastExecutor> executor_;
};

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

/// D: the user's map or the network's, normalised to [0, 1].
void find_disparity(const SlideInput& input, const SlideModels& models, const SlideOptions& options,
                    SlideLayers& out) {
  Stage stage("depth", options);
  Graph& g = stage.graph();
  const bool given = !input.disparity.empty();
  if (!given && !models.depth.chosen())
    throw Error(ErrorKind::kUsage, "there is neither a depth map nor a depth network",
                "give --depth FILE, or --depth-weights FILE");
  if (given)
    g.output("D", ops::min_max_normalise(g.input("disparity", input.disparity.shape())));
  else
    g.output("D", estimate_disparity(g.input("image", input.image.shape()), models.depth));
  if (given)
    stage.run(kNoWeights, {{"disparity", input.disparity}});
  else
    stage.run(*models.depth.weights, {{"image", input.image}});
  out.disparity = stage.take("D");
  require_finite("network's disparity", out.disparity, ErrorKind::kInternal);
  out.report.stages.push_back(stage.report());
  out.report.relief = max_abs(out.disparity) > 0;
}

bool stands_out(const Tensor& matte, double coverage) {
  if (coverage < kLeastCoverage || coverage > kLargestCoverage) return false;
  return fraction_above(matte, 0.9F) > kDecided * fraction_above(matte, 0.1F);
}

/// The saliency network's matte refined by the matting network.
void refine(const SlideModels& models, const SlideOptions& options, Tensor& matte, SlideLayers& out) {
  Stage stage("matting", options);
  Graph& g = stage.graph();
  g.output("M", refine_matte(g.input("image", out.image.shape()), g.input("saliency", matte.shape()),
                             models.matting));
  stage.run(*models.matting.weights, {{"image", out.image}, {"saliency", matte}});
  matte = stage.take("M");
  require_finite("refined matte", matte, ErrorKind::kInternal);
  out.report.stages.push_back(stage.report());
  out.report.matte_refined = true;
  out.report.matte_coverage = fraction_above(matte, 0.5F);
}

/// M: the user's, or the saliency network's if it is asked for and (kAuto) shows a subject, refined if there
/// is a matting network.
void find_matte(const SlideInput& input, const SlideModels& models, const SlideOptions& options,
                SlideLayers& out) {
  Tensor matte = input.matte;
  if (matte.empty()) {
    if (options.matte == MatteUse::kNever) return;
    if (!models.saliency.chosen())
      throw Error(ErrorKind::kUsage, "a matte is asked for, and there is no saliency network",
                  "give --matte FILE, or --saliency-weights FILE");
    Stage stage("saliency", options);
    stage.graph().output("M",
                         estimate_matte(stage.graph().input("image", input.image.shape()), models.saliency));
    stage.run(*models.saliency.weights, {{"image", input.image}});
    matte = stage.take("M");
    require_finite("network's matte", matte, ErrorKind::kInternal);
    out.report.stages.push_back(stage.report());
  }
  out.report.matte_coverage = fraction_above(matte, 0.5F);
  const bool forced = !input.matte.empty() || options.matte == MatteUse::kAlways;
  if (!forced && !stands_out(matte, out.report.matte_coverage)) return;
  if (input.matte.empty() && models.matting.chosen()) refine(models, options, matte, out);
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
std::optional<SubjectMaps> follow_matte(const SlideOptions& options, SlideLayers& out) {
  out.front_image = out.image;
  if (out.matte.empty()) return std::nullopt;
  Stage stage("subject", options);
  (void)subject_graph(stage.graph(), out.matte.shape());
  stage.run(kNoWeights, {{"I", out.image}, {"D", out.disparity}, {"M", out.matte}});
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

void split_layers(const std::optional<SubjectMaps>& subject, const SlideOptions& options, SlideLayers& out) {
  Stage stage("layering", options);
  layering_graph(stage.graph(), out.disparity.shape(), out.report.layering, subject.has_value());
  NamedTensors inputs = {{"D", out.disparity}};
  if (subject) {
    inputs["M"] = out.matte;
    inputs["p"] = subject->moves;
    inputs["opaque"] = subject->opaque;
  }
  stage.run(kNoWeights, inputs);
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
void inpaint_windows(const std::optional<SubjectMaps>& subject, const SlideModels& models,
                     const SlideOptions& options, SlideLayers& out) {
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
    Stage stage(total.name, options);
    background_graph(stage.graph(), {1, 1, w.height(), w.width()}, fill_margin(shape), models.inpaint, matte);
    NamedTensors inputs = {{"I", cut(behind, w)},
                           {"D1", cut(out.conditioned, w)},
                           {"S", cut(out.disocclusion, w)},
                           {"H", cut(out.hole, w)}};
    if (matte) {
      inputs["clear"] = cut(subject->clear, w);
      inputs["e"] = cut(subject->agreement, w);
    }
    stage.run(models.inpaint.chosen() ? *models.inpaint.weights : kNoWeights, inputs, done / area,
              static_cast<double>(w.area()) / area);
    paste(stage.take("I_bg"), w, out.background_image);
    paste(stage.take("D_bg"), w, out.background_disparity);
    done += static_cast<double>(w.area());
    total.seconds += stage.report().seconds;
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
  check_input(input);
  SlideLayers out;
  out.image = input.image;
  out.report.layering = resolve(options.layering);
  find_disparity(input, models, options, out);
  if (out.report.relief) find_matte(input, models, options, out);
  const std::optional<SubjectMaps> subject = follow_matte(options, out);
  split_layers(subject, options, out);
  if (!out.report.relief)
    out.report.inpainting = "none: the scene has no relief";
  else if (out.report.hole_fraction == 0)
    out.report.inpainting = "none: nothing comes into view";
  else
    inpaint_windows(subject, models, options, out);
  return out;
}

std::vector<PlannedStage> plan_layers(std::int64_t height, std::int64_t width, const SlideModels& models,
                                      const SlideInput& known, const SlideOptions& options) {
  const Shape map{1, 1, height, width};
  std::vector<PlannedStage> stages;
  if (known.disparity.empty() && models.depth.chosen()) {
    Stage depth("depth", options);
    depth.graph().output("D", estimate_disparity(depth.graph().input("image", map.with(1, 3)), models.depth));
    stages.push_back(std::move(depth).plan(models.depth));
  }
  if (known.matte.empty() && options.matte != MatteUse::kNever && models.saliency.chosen()) {
    Stage saliency("saliency", options);
    saliency.graph().output("M",
                            estimate_matte(saliency.graph().input("image", map.with(1, 3)), models.saliency));
    stages.push_back(std::move(saliency).plan(models.saliency));
    if (models.matting.chosen()) {
      Stage matting("matting", options);
      Graph& g = matting.graph();
      g.output("M", refine_matte(g.input("image", map.with(1, 3)), g.input("saliency", map), models.matting));
      stages.push_back(std::move(matting).plan(models.matting));
    }
  }
  const bool matte = !known.matte.empty() || options.matte != MatteUse::kNever;
  if (matte) {
    Stage subject("subject", options);
    (void)subject_graph(subject.graph(), map);
    stages.push_back(std::move(subject).plan());
  }
  Stage layering("layering", options);
  layering_graph(layering.graph(), map, resolve(options.layering), matte);
  stages.push_back(std::move(layering).plan());
  Stage inpainting("inpainting", options);
  background_graph(inpainting.graph(), map, fill_margin(map), models.inpaint, matte && fills(models.inpaint));
  stages.push_back(std::move(inpainting).plan(models.inpaint));
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

std::unique_ptr<WeightSource> slide_weights(const SlideModels& models) {
  return std::make_unique<ScopedWeights>(models);
}

}  // namespace slide::graphs
