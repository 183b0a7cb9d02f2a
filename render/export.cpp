#include "render/export.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "render/camera_path.h"
#include "render/edge_zoom.h"
#include "render/frame_sink.h"
#include "render/html.h"
#include "render/ply.h"
#include "render/view.h"
#include "render/write_image.h"
#include "runtime/error.h"

namespace slide {
namespace {

ViewRenderer make_renderer(const Layers& layers, const Camera& camera, const std::vector<View>& views,
                           double tolerance) {
  if (tolerance <= 0) return {layers, camera};
  return {layers, camera, mesh_tolerance(camera, views, tolerance)};
}

DrawnMeshes meshes_of(const ViewRenderer& renderer, const Layers& layers, const Camera& camera) {
  const std::size_t cells =
      static_cast<std::size_t>(camera.width + 1) * static_cast<std::size_t>(camera.height + 1);
  return {renderer.triangle_count(), 2 * cells * (layers.background ? 2 : 1)};
}

constexpr double kFps = 30;
constexpr double kGifFps = 15;
constexpr int kGifSide = 480;

/// The options of a GIF: small unless asked otherwise.
ExportOptions gif_options(ExportOptions o, const Camera& camera) {
  const double scale = std::min(1.0, static_cast<double>(kGifSide) / std::max(camera.width, camera.height));
  const auto scaled = [scale](int side) { return std::max(1, static_cast<int>(std::lround(side * scale))); };
  if (o.width == 0) {
    o.width = scaled(camera.width);
    o.height = scaled(camera.height);
  }
  return o;
}

/// Of views that are 1/30 s apart those that are 1/15 s apart.
std::vector<View> gif_views(const std::vector<View>& views) {
  constexpr auto kStep = static_cast<std::size_t>(kFps / kGifFps);
  std::vector<View> kept;
  for (std::size_t i = 0; i < views.size(); i += kStep) kept.push_back(views[i]);
  return kept;
}

RenderOptions render_options(const ExportOptions& o, const Camera& camera) {
  return {.width = o.width > 0 ? o.width : camera.width,
          .height = o.height > 0 ? o.height : camera.height,
          .supersample = o.supersample};
}

std::vector<View> framed(const Camera& camera, const std::vector<View>& views, const ExportOptions& options) {
  return options.keep_edges ? views : without_edges(camera, views);
}

DrawnMeshes export_frames(const std::string& path, const Layers& layers, const Camera& camera,
                          const std::vector<View>& views, const ExportOptions& options) {
  const std::vector<View> shown = framed(camera, views, options);
  const RenderOptions size = render_options(options, camera);
  ViewRenderer renderer = make_renderer(layers, camera, shown, options.mesh_tolerance);
  const std::unique_ptr<FrameSink> sink = make_frame_sink(path);
  sink->begin({size.width, size.height, options.fps.value_or(kFps), static_cast<int>(shown.size())});
  Image frame;
  for (std::size_t i = 0; i < shown.size(); ++i) {
    if (options.progress) options.progress(static_cast<double>(i) / static_cast<double>(shown.size()));
    renderer.render(shown[i], size, frame);
    sink->frame(frame);
  }
  sink->finish();
  return meshes_of(renderer, layers, camera);
}

}  // namespace

bool is_page_output(const std::string& path) {
  const std::string extension = lower_extension(path);
  return extension == ".html" || extension == ".htm";
}

void require_export_output(const std::string& path) {
  const std::string extension = lower_extension(path);
  if (is_page_output(path) || extension == ".glb" || extension == ".ply" || is_frame_output(path)) return;
  throw Error(ErrorKind::kUsage, "nothing can be made of the extension of " + path,
              ".html .glb .ply .gif .png .apng .mp4 .webm .y4m, a folder, or - for standard output");
}

DrawnMeshes export_file(const std::string& path, const Layers& layers, const Camera& camera,
                        const std::vector<View>& views, const ExportOptions& options) {
  require_export_output(path);
  const std::string extension = lower_extension(path);
  if (is_page_output(path)) {
    write_html(path, layers, camera,
               {.title = options.title,
                .alt = options.alt,
                .parallax_percent = options.parallax_percent,
                .focus = options.focus});
    return {};
  }
  if (extension == ".glb") {
    write_glb(
        path, layers, camera,
        {.parallax = largest_parallax(camera, views), .depth = options.glb_depth, .focus = options.focus});
    return {};
  }
  if (extension == ".ply") {
    write_ply(path, layers, camera);
    return {};
  }
  if (extension != ".gif") return export_frames(path, layers, camera, views, options);
  ExportOptions small = gif_options(options, camera);
  if (options.fps) return export_frames(path, layers, camera, views, small);
  small.fps = kGifFps;
  return export_frames(path, layers, camera, gif_views(views), small);
}

bool is_still_output(const std::string& path) {
  const std::string extension = lower_extension(path);
  return extension == ".png" || extension == ".jpg" || extension == ".jpeg";
}

DrawnMeshes export_stereo(const std::string& path, StereoKind kind, const Layers& layers,
                          const Camera& camera, const std::vector<Eyes>& eyes, const ExportOptions& options) {
  std::vector<View> views;
  for (const Eyes& pair : eyes) views.insert(views.end(), {pair.left, pair.right});
  views = framed(camera, views, options);
  ViewRenderer renderer = make_renderer(layers, camera, views, options.mesh_tolerance);
  const RenderOptions size = render_options(options, camera);
  Image left;
  Image right;
  const auto picture = [&](std::size_t i) {
    renderer.render(views[2 * i], size, left);
    renderer.render(views[2 * i + 1], size, right);
    return stereo_picture(kind, left, right);
  };
  if (is_still_output(path)) {
    write_image(path, picture(0));
    return meshes_of(renderer, layers, camera);
  }
  const std::unique_ptr<FrameSink> sink = make_frame_sink(path);
  for (std::size_t i = 0; i < eyes.size(); ++i) {
    if (options.progress) options.progress(static_cast<double>(i) / static_cast<double>(eyes.size()));
    const Image frame = picture(i);
    if (i == 0)
      sink->begin({frame.width, frame.height, options.fps.value_or(kFps), static_cast<int>(eyes.size())});
    sink->frame(frame);
  }
  sink->finish();
  return meshes_of(renderer, layers, camera);
}

}  // namespace slide
