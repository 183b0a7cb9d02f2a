#include "examples/c_api/slide.h"

#include <cmath>
#include <numbers>
#include <string>

#include "examples/network_files.h"
#include "render/camera_path.h"
#include "render/export.h"
#include "render/image_file.h"
#include "render/own_output.h"
#include "render/photo_layers.h"
#include "render/view.h"
#include "runtime/atomic_file.h"
#include "runtime/error.h"
#include "runtime/error_model.h"
#include "runtime/memory_limit.h"
#include "runtime/program.h"
#include "runtime/threads.h"
#include "runtime/version.h"

struct slide_photo {
  slide::Layers layers;
  slide::Camera camera;
  std::vector<slide::View> views;
  slide::ExportOptions export_options;
  std::optional<slide::ViewRenderer> renderer;
  bool overwrite = false;
  std::string source;  ///< the file it comes from, which is never replaced
};

namespace {

using slide::Error;
using slide::ErrorKind;

thread_local std::string last_error;  // NOLINT(cppcoreguidelines-avoid-non-const-global-variables)

/// Runs `call` and turns whatever it throws into a status and a message.
template <typename Call>
slide_status guarded(const Call& call) {
  last_error.clear();
  try {
    call();
    return SLIDE_OK;
  } catch (...) {
    const slide::Failure failure = slide::current_failure();
    last_error = failure.message;
    return static_cast<slide_status>(slide::exit_code(failure.kind));
  }
}

void require(bool good, const char* problem) {
  if (!good) throw Error(ErrorKind::kUsage, problem);
}

std::string text(const char* s) { return s == nullptr ? "" : s; }

slide::graphs::SlideLayers make_layers(const slide::graphs::SlideInput& input, const slide_settings& s,
                                       double parallax) {
  slide::NetworkFiles files;
  slide::graphs::SlideModels models;
  if (input.disparity.empty()) models.depth = files.open(text(s.depth_weights), "", "slide_depth", "depth");
  if (text(s.inpaint_weights) != "fill")
    models.inpaint = files.open(text(s.inpaint_weights), "", "slide_inpaint", "inpaint");
  slide::graphs::SlideOptions options;
  options.layering.parallax = parallax;
  options.memory_limit = s.memory_limit != 0 ? s.memory_limit : slide::memory_of_process();
  const slide::PrecisionChoice choice = slide::precision_choice(
      text(s.precision), s.error_budget == 0 ? std::nullopt : std::optional(s.error_budget));
  options.precision = choice.precision;
  options.error_budget = choice.error_budget;
  if (s.progress != nullptr)
    options.progress = [&s](const std::string& stage, double part, std::string_view) {
      return s.progress(s.user, stage.c_str(), part) != 0;
    };
  return slide::graphs::make_layers(input, models, options);
}

std::unique_ptr<slide_photo> create(const slide::Image& colour, const slide::Image& disparity,
                                    double fov_degrees, const slide_settings& s) {
  require(s.max_side >= 16 && s.max_side <= 16384, "max_side is not in 16 to 16384");
  const slide::Image reduced = shrink_to(colour, s.max_side);
  auto photo = std::make_unique<slide_photo>();
  photo->camera = slide::make_camera(reduced.width, reduced.height, fov_degrees, s.near_depth, s.far_depth);
  photo->views = slide::make_path(
      photo->camera, {.parallax_percent = s.parallax_percent, .focus = s.focus, .frames = s.frames});
  photo->export_options.parallax_percent = s.parallax_percent;
  photo->export_options.focus = s.focus;
  photo->overwrite = s.overwrite != 0;
  if (s.fps != 0) photo->export_options.fps = s.fps;
  slide::graphs::SlideInput input;
  input.image = slide::tensor_from_image(reduced);
  if (!disparity.empty())
    input.disparity = slide::disparity_from_map(disparity, slide::DepthKind::kDisparity, reduced.width,
                                                reduced.height, "the disparity");
  photo->layers =
      slide::layers_from(make_layers(input, s, slide::largest_parallax(photo->camera, photo->views)));
  return photo;
}

const slide_settings& checked(const slide_settings* settings) {
  require(settings != nullptr && settings->struct_size == sizeof(slide_settings),
          "the settings were not made by slide_settings_init() of this version");
  return *settings;
}

}  // namespace

void slide_settings_init(slide_settings* settings) {
  *settings = {.struct_size = sizeof(slide_settings),
               .parallax_percent = 4,
               .focus = 0.5,
               .fov_degrees = 0,
               .near_depth = 1,
               .far_depth = 10,
               .max_side = 1536,
               .frames = 60,
               .fps = 0,
               .memory_limit = 0,
               .depth_weights = nullptr,
               .inpaint_weights = nullptr,
               .precision = nullptr,
               .error_budget = 0,
               .overwrite = 0,
               .progress = nullptr,
               .user = nullptr};
}

slide_status slide_create(const float* rgb, const float* disparity, int width, int height,
                          const slide_settings* settings, slide_photo** photo) {
  return guarded([&] {
    require(rgb != nullptr && photo != nullptr, "rgb or photo is NULL");
    const slide_settings& s = checked(settings);
    slide::check_image_size(width, height, "the image");
    slide::Image colour(width, height, 3);
    colour.data.assign(rgb, rgb + colour.data.size());
    slide::Image map;
    if (disparity != nullptr) {
      map = slide::Image(width, height, 1);
      map.data.assign(disparity, disparity + map.data.size());
      slide::require_finite(map, "the disparity");
    }
    *photo = create(colour, map, s.fov_degrees > 0 ? s.fov_degrees : slide::kDefaultFov, s).release();
  });
}

slide_status slide_open(const char* path, const slide_settings* settings, slide_photo** photo) {
  return guarded([&] {
    require(path != nullptr && photo != nullptr, "path or photo is NULL");
    const slide_settings& s = checked(settings);
    const slide::Photo file = slide::read_photo(path);
    const double exif =
        file.horizontal_fov ? *file.horizontal_fov * 180 / std::numbers::pi : slide::kDefaultFov;
    auto made = create(file.colour, {}, s.fov_degrees > 0 ? s.fov_degrees : exif, s);
    made->source = path;
    *photo = made.release();
  });
}

slide_status slide_size(const slide_photo* photo, int* width, int* height) {
  return guarded([&] {
    require(photo != nullptr && width != nullptr && height != nullptr, "photo, width or height is NULL");
    *width = photo->camera.width;
    *height = photo->camera.height;
  });
}

slide_status slide_render(slide_photo* photo, double x, double y, double z, int width, int height,
                          float* rgb) {
  return guarded([&] {
    require(photo != nullptr && rgb != nullptr, "photo or rgb is NULL");
    require(std::isfinite(x) && std::isfinite(y) && std::isfinite(z), "the camera's place is not finite");
    if (!photo->renderer) photo->renderer.emplace(photo->layers, photo->camera);
    slide::View view;
    view.pose.translation = {-x, -y, -z};
    slide::Image out;
    photo->renderer->render(view, {.width = width, .height = height}, out);
    std::copy(out.data.begin(), out.data.end(), rgb);
  });
}

slide_status slide_export(const slide_photo* photo, const char* path) {
  return guarded([&] {
    require(photo != nullptr && path != nullptr, "photo or path is NULL");
    require(!slide::same_file(path, photo->source), "the photo itself would be replaced");
    if (!photo->overwrite) slide::require_replaceable(path);
    (void)slide::export_file(path, photo->layers, photo->camera, photo->views, photo->export_options);
  });
}

void slide_free(slide_photo* photo) { delete photo; }

const char* slide_last_error(void) { return last_error.c_str(); }

const char* slide_version(void) { return slide::version().data(); }

void slide_set_threads(int count) { slide::set_thread_count(count); }
