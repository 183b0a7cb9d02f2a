// 3D photos: made, looked into, drawn.

#include <cmath>
#include <cstdint>
#include <numbers>
#include <span>

#include "examples/c_api/internal.h"
#include "render/camera_path.h"
#include "render/edge_zoom.h"
#include "render/image_file.h"
#include "render/photo_layers.h"
#include "render/write_image.h"
#include "runtime/thread_scope.h"

using namespace slide::c_api;

namespace {

/// Poses are rotations up to rounding.
constexpr double kRotationTolerance = 1e-3;

slide_scene default_scene() {
  slide_scene s{};
  s.struct_size = sizeof s;
  s.parallax_percent = 4;
  s.focus = 0.5;
  s.frames = 60;
  s.near_depth = 1;
  s.far_depth = 10;
  return s;
}

bool is_rotation(const glm::dmat3& r) {
  const glm::dmat3 product = r * glm::transpose(r);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (!(std::abs(product[i][j] - (i == j ? 1 : 0)) <= kRotationTolerance)) return false;
  return glm::determinant(r) > 0;
}

slide::View from_c(const slide_view& v) {
  slide::View view;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) view.pose.rotation[column][row] = v.rotation[3 * row + column];
  view.pose.translation = {v.translation[0], v.translation[1], v.translation[2]};
  view.zoom = v.zoom;
  view.shift = {v.shift[0], v.shift[1]};
  const auto finite = [](double x) { return std::isfinite(x) && std::abs(x) <= 1e6; };
  require(std::all_of(std::begin(v.translation), std::end(v.translation), finite) && finite(v.shift[0]) &&
              finite(v.shift[1]),
          "a view's translation or shift is not finite, or beyond 1e6");
  require(v.zoom >= 1e-3 && v.zoom <= 1e3, "a view's zoom is not in 0.001 to 1000");
  require(is_rotation(view.pose.rotation), "a view's rotation is none");
  return view;
}

slide_view to_c(const slide::View& view) {
  slide_view v{};
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) v.rotation[3 * row + column] = view.pose.rotation[column][row];
  for (int i = 0; i < 3; ++i) v.translation[i] = view.pose.translation[i];
  v.zoom = view.zoom;
  v.shift[0] = view.shift.x;
  v.shift[1] = view.shift.y;
  return v;
}

std::vector<slide::View> views_of(const slide_scene& s, const slide::Camera& camera) {
  constexpr std::size_t kMostViews = 100000;
  if (s.views != nullptr) {
    require(s.path == nullptr, "path and views are both given");
    require(s.view_count >= 1 && s.view_count <= kMostViews, "view_count is not in 1 to 100000");
    std::vector<slide::View> views;
    for (std::size_t i = 0; i < s.view_count; ++i) views.push_back(from_c(s.views[i]));
    return views;
  }
  require(s.view_count == 0, "view_count is given, and views is NULL");
  const std::string path = s.path == nullptr ? "circle" : s.path;
  if (slide::lower_extension(path) == ".json") return slide::read_pose_file(path);
  return slide::make_path(camera, {.kind = slide::path_kind(path),
                                   .parallax_percent = s.parallax_percent,
                                   .focus = s.focus,
                                   .frames = s.frames});
}

/// What a caller gives beside the colours.
struct Given {
  const slide_image* disparity = nullptr;
  const slide_image* matte = nullptr;
  std::optional<double> fov;  ///< degrees, as the photo's file tells
};

slide::graphs::SlideInput input_of(const slide::Image& colours, const Given& given) {
  slide::graphs::SlideInput input;
  input.image = slide::tensor_from_image(colours);
  if (given.disparity != nullptr)
    input.disparity =
        slide::disparity_from_map(read_map(*given.disparity, "the disparity"), slide::DepthKind::kDisparity,
                                  colours.width, colours.height, "the disparity");
  if (given.matte != nullptr)
    input.matte = slide::matte_from_map(read_map(*given.matte, "the matte"), colours.width, colours.height,
                                        "the matte");
  return input;
}

std::unique_ptr<slide_photo> make(slide_model& model, const slide::Image& colours, const Given& given,
                                  const slide_scene* scene) {
  const slide_scene s = completed(scene, default_scene(), "slide_scene_init");
  const slide::ThreadScope threads(model.threads);
  const slide::Image reduced = slide::shrink_to(colours, model.max_side);
  if (reduced.width != colours.width)
    model.say("the photo was reduced from " + std::to_string(colours.width) + "x" +
              std::to_string(colours.height) + " to " + std::to_string(reduced.width) + "x" +
              std::to_string(reduced.height) + " (max_side)");
  auto photo = std::make_unique<slide_photo>();
  photo->threads = model.threads;
  photo->parallax_percent = s.parallax_percent;
  photo->focus = s.focus;
  const double fov = s.fov_degrees != 0 ? s.fov_degrees : given.fov.value_or(slide::kDefaultFov);
  photo->camera = slide::make_camera(reduced.width, reduced.height, fov, s.near_depth, s.far_depth);
  photo->views = views_of(s, photo->camera);
  photo->shown = slide::without_edges(photo->camera, photo->views);
  slide::graphs::SlideOptions options = model.options;
  options.depth_edges = slide::graphs::DepthEdges::kAuto;
  options.layering.parallax = slide::largest_parallax(photo->camera, photo->views);
  options.matte = s.find_subject != 0 ? slide::graphs::MatteUse::kAuto : slide::graphs::MatteUse::kNever;
  const slide::graphs::SlideLayers made = model.pipeline->make_layers(input_of(reduced, given), options);
  for (const slide::graphs::StageReport& stage : made.report.stages) model.say(stage);
  photo->layers = slide::layers_from(made);
  photo->disparity = made.disparity;
  photo->hole = made.hole;
  photo->matte = made.matte;
  return photo;
}

std::optional<double> fov_of(const slide::Photo& photo) {
  if (!photo.horizontal_fov) return std::nullopt;
  return std::clamp(*photo.horizontal_fov * 180 / std::numbers::pi, 1.0, 170.0);
}

/// A map of the photo; empty if there is none.
slide::Image map_of(const slide_photo& photo, int map) {
  const auto image = [](const slide::Tensor& t) { return t.empty() ? slide::Image() : image_from_tensor(t); };
  const slide::Layers& layers = photo.layers;
  const slide::Layer none;
  const slide::Layer& background = layers.background ? *layers.background : none;
  switch (map) {
    case SLIDE_FRONT_COLOUR:
      return layers.foreground.colour;
    case SLIDE_FRONT_DISPARITY:
      return layers.foreground.disparity;
    case SLIDE_VISIBILITY:
      return layers.foreground.alpha;
    case SLIDE_BACKGROUND_COLOUR:
      return background.colour;
    case SLIDE_BACKGROUND_DISPARITY:
      return background.disparity;
    case SLIDE_DISPARITY:
      return image(photo.disparity);
    case SLIDE_HOLE:
      return image(photo.hole);
    case SLIDE_MATTE:
      return image(photo.matte);
  }
  throw slide::Error(slide::ErrorKind::kUsage, "there is no map " + std::to_string(map));
}

}  // namespace

void slide_scene_init(slide_scene* scene, size_t size) { fill_defaults(scene, size, default_scene()); }

slide_view slide_view_at(double x, double y, double z) {
  slide::View view;
  view.pose.translation = {-x, -y, -z};
  return to_c(view);
}

slide_status slide_make(slide_model* model, const slide_image* image, const slide_image* disparity,
                        const slide_image* matte, const slide_scene* scene, slide_photo** photo) {
  return guarded([&] {
    require(model != nullptr && photo != nullptr, "model or photo is NULL");
    *photo = make(*model, read_colours(image), {disparity, matte, {}}, scene).release();
  });
}

slide_status slide_open(slide_model* model, const char* path, const slide_scene* scene, slide_photo** photo) {
  return guarded([&] {
    require(model != nullptr && path != nullptr && photo != nullptr, "model, path or photo is NULL");
    const slide::Photo file = slide::read_photo(path);
    auto made = make(*model, file.colour, {nullptr, nullptr, fov_of(file)}, scene);
    made->source = path;
    *photo = made.release();
  });
}

slide_status slide_decode(slide_model* model, const void* bytes, size_t size, const slide_scene* scene,
                          slide_photo** photo) {
  return guarded([&] {
    require(model != nullptr && bytes != nullptr && photo != nullptr, "model, bytes or photo is NULL");
    const slide::Photo file =
        slide::decode_photo({static_cast<const std::uint8_t*>(bytes), size}, "the photo");
    *photo = make(*model, file.colour, {nullptr, nullptr, fov_of(file)}, scene).release();
  });
}

void slide_photo_free(slide_photo* photo) { delete photo; }

slide_status slide_photo_size(const slide_photo* photo, int* width, int* height) {
  return guarded([&] {
    require(photo != nullptr && width != nullptr && height != nullptr, "photo, width or height is NULL");
    *width = photo->camera.width;
    *height = photo->camera.height;
  });
}

int slide_photo_has(const slide_photo* photo, int map) {
  int has = 0;
  (void)guarded([&] { has = photo != nullptr && !map_of(*photo, map).empty() ? 1 : 0; });
  return has;
}

slide_status slide_photo_map(const slide_photo* photo, int map, const slide_buffer* out) {
  return guarded([&] {
    require(photo != nullptr && out != nullptr && out->data != nullptr, "photo, buffer or its data is NULL");
    const slide::Image image = map_of(*photo, map);
    require(!image.empty(), "the photo has no such map (slide_photo_has() tells)");
    write_buffer(image, *out);
  });
}

size_t slide_photo_view_count(const slide_photo* photo) { return photo == nullptr ? 0 : photo->views.size(); }

slide_status slide_photo_view(const slide_photo* photo, size_t index, slide_view* view) {
  return guarded([&] {
    require(photo != nullptr && view != nullptr, "photo or view is NULL");
    require(index < photo->shown.size(), "there is no view of that index");
    *view = to_c(photo->shown[index]);
  });
}

slide_status slide_render(slide_photo* photo, const slide_view* view, const slide_buffer* out) {
  return guarded([&] {
    require(photo != nullptr && view != nullptr && out != nullptr, "photo, view or buffer is NULL");
    require(out->width >= 1 && out->height >= 1, "the buffer's width or height is below 1");
    check_buffer(out, out->width, out->height, 3);
    const slide::View seen = from_c(*view);
    const slide::ThreadScope threads(photo->threads);
    if (!photo->renderer) photo->renderer.emplace(photo->layers, photo->camera);
    slide::Image image;
    photo->renderer->render(seen, {.width = out->width, .height = out->height}, image);
    write_buffer(image, *out);
  });
}
