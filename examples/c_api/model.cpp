// Settings, models, and depth alone.

#include <cstdio>

#include "examples/c_api/internal.h"
#include "graphs/stages.h"
#include "render/image_file.h"
#include "render/photo_layers.h"
#include "runtime/error_model.h"
#include "runtime/memory_limit.h"
#include "runtime/thread_scope.h"
#include "runtime/threads.h"
#include "runtime/version.h"

using namespace slide::c_api;

namespace {

thread_local std::string last_error;  // NOLINT(cppcoreguidelines-avoid-non-const-global-variables)

slide_settings default_settings() {
  slide_settings s{};
  s.struct_size = sizeof s;
  s.max_side = 1536;
  return s;
}

void open_networks(const slide_settings& s, slide_model& model) {
  slide::graphs::SlideModels models;
  models.depth = model.files.open(text(s.depth_weights), "", "slide_depth", "depth");
  models.depth.side = s.depth_side;
  if (models.depth.chosen()) (void)slide::graphs::depth_side(models.depth);
  if (text(s.inpaint_weights) != "fill")
    models.inpaint = model.files.open(text(s.inpaint_weights), "", "slide_inpaint", "inpaint");
  models.saliency = model.files.open(text(s.matte_weights), "", "slide_matte", "saliency");
  models.matting = model.files.open("", "", slide::default_refiner(models.saliency), "matting");
  model.pipeline = std::make_unique<slide::graphs::Pipeline>(models);
}

void take_options(const slide_settings& s, slide_model& model) {
  require(s.max_side >= 16 && s.max_side <= 16384, "max_side is not in 16 to 16384");
  require(s.threads >= 0 && s.threads <= 1024, "threads is not in 0 to 1024");
  slide::graphs::SlideOptions& options = model.options;
  options.memory_limit = s.memory_limit != 0 ? s.memory_limit : slide::memory_of_process();
  const slide::PrecisionChoice choice = slide::precision_choice(
      text(s.precision), s.error_budget == 0 ? std::nullopt : std::optional(s.error_budget));
  options.precision = choice.precision;
  options.error_budget = choice.error_budget;
  if (s.progress != nullptr)
    options.progress = [progress = s.progress, user = s.user](const std::string& stage, double part,
                                                              std::string_view) {
      return progress(user, stage.c_str(), part) != 0;
    };
  model.max_side = s.max_side;
  // Decided once: what is prepared for so many threads is run by so many.
  model.threads = s.threads > 0 ? s.threads : slide::thread_count();
  model.log = s.log;
  model.user = s.user;
}

}  // namespace

void slide::c_api::set_last_error(const std::string& message) noexcept {
  try {
    last_error = message;
  } catch (...) {
    last_error.clear();
  }
}

void slide_model::say(const slide::graphs::StageReport& stage) const {
  if (log == nullptr) return;
  char preparing[64];
  std::snprintf(preparing, sizeof preparing, "%.3f s of it preparing", stage.preparing);
  char line[160];
  std::snprintf(line, sizeof line, "%s: %.3f s, %s; %.2f GFLOP, %.1f MiB", stage.name.c_str(), stage.seconds,
                stage.reused ? "prepared before" : preparing, stage.gflop,
                static_cast<double>(stage.memory) / 1048576);
  say(std::string(line));
}

void slide_settings_init(slide_settings* settings, size_t size) {
  fill_defaults(settings, size, default_settings());
}

slide_status slide_model_create(const slide_settings* settings, slide_model** model) {
  return guarded([&] {
    require(model != nullptr, "model is NULL");
    const slide_settings s = completed(settings, default_settings(), "slide_settings_init");
    auto made = std::make_unique<slide_model>();
    take_options(s, *made);
    open_networks(s, *made);
    *model = made.release();
  });
}

void slide_model_free(slide_model* model) { delete model; }

slide_status slide_model_prepare(slide_model* model, int width, int height) {
  return guarded([&] {
    require(model != nullptr, "model is NULL");
    slide::check_image_size(width, height, "the image");
    const slide::ThreadScope threads(model->threads);
    model->pipeline->prepare_disparity(height, width, model->options);
  });
}

slide_status slide_disparity(slide_model* model, const slide_image* image, const slide_buffer* disparity) {
  return guarded([&] {
    require(model != nullptr, "model is NULL");
    const slide::Image colours = read_colours(image);
    check_buffer(disparity, colours.width, colours.height, 1);
    const slide::ThreadScope threads(model->threads);
    slide::graphs::StageReport report;
    const slide::Tensor map =
        model->pipeline->disparity(slide::tensor_from_image(colours), model->options, &report);
    write_buffer(slide::image_from_tensor(map), *disparity);
    model->say(report);
  });
}

const char* slide_last_error(void) { return last_error.c_str(); }

const char* slide_version(void) { return slide::version().data(); }
