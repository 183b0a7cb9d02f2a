// A view is drawn in bands of rows, each by one thread from emptying its fragments to writing its pixels, so
// that a band's fragments stay in the second-level cache. Fragments are drawn first and shaded once they are
// known to be seen.
#include "render/view.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "render/camera_path.h"
#include "render/projection.h"
#include "render/texture.h"
#include "runtime/error.h"
#include "runtime/threads.h"

namespace slide {
namespace {

struct DrawableLayer {
  DrawableLayer(const Layer& layer, std::optional<double> tolerance)
      : texture(layer),
        mesh(tolerance ? adaptive_mesh(layer.disparity, *tolerance) : full_mesh(layer.disparity)) {}
  Texture texture;
  Mesh mesh;
  ProjectedMesh projected;
};

/// What a thread needs to draw a band.
struct Scratch {
  FragmentBand foreground;
  FragmentBand background;
  std::vector<float> pixels;  ///< of two rows: colour and coverage, four floats each
};

/// The texture coordinates of four neighbouring fragments; 0 where there is none.
struct FourCoordinates {
  Int4 covered;
  Float4 u, v;
};

FourCoordinates texture_coordinates(const FragmentBand& band, const Texture& texture, int y, int x) {
  const Float4 q = load4(band.q(y) + x);
  const Float4 zero{};
  const Int4 covered = q > zero;
  const Float4 inverse = splat(1.0F) / select(covered, load4(band.s(y) + x), splat(1.0F));
  const Float4 u = select(covered, load4(band.us(y) + x) * inverse, zero);
  const Float4 v = select(covered, load4(band.vs(y) + x) * inverse, zero);
  return {covered, min4(max4(u, zero), splat(texture.right())), min4(max4(v, zero), splat(texture.bottom()))};
}

/// Colour in the first three lanes, coverage (1) in the last.
Float4 composite(const Texture& foreground, const Texture* background, const FourCoordinates& f,
                 const FourCoordinates& b, int lane) {
  const Float4 front = f.covered[lane] != 0 ? foreground.sample(f.u[lane], f.v[lane]) : Float4{};
  const bool any_layer = f.covered[lane] != 0 || b.covered[lane] != 0;
  Float4 result = front;
  if (background != nullptr) {
    const float alpha = front[3];
    const Float4 back = b.covered[lane] != 0 ? background->sample(b.u[lane], b.v[lane]) : Float4{};
    result = splat(alpha) * front + splat(1.0F - alpha) * back;
  }
  result[3] = any_layer ? 1.0F : 0.0F;
  return result;
}

/// Averages pairs of pixels of two rows: result i = mean of pixels 2i, 2i + 1 of both.
void average(const float* upper, const float* lower, int width, float* out) {
  for (int x = 0; x < width; ++x) {
    const Float4 sum =
        (load4(upper + 8 * x) + load4(upper + 8 * x + 4)) + (load4(lower + 8 * x) + load4(lower + 8 * x + 4));
    store4(out + 4 * x, sum * 0.25F);
  }
}

void write_row(const float* pixels, int width, float* out, float* coverage) {
  for (int x = 0; x < width; ++x) {
    for (int c = 0; c < 3; ++c) out[3 * x + c] = pixels[4 * x + c];
    if (coverage != nullptr) coverage[x] = pixels[4 * x + 3];
  }
}

void fit(Image& image, int width, int height, int channels) {
  if (image.width != width || image.height != height || image.channels != channels) {
    image = Image(width, height, channels);
  }
}

}  // namespace

double mesh_tolerance(const Camera& camera, const std::vector<View>& views, double pixels) {
  const double rate = largest_parallax_rate(camera, views);
  return rate > pixels ? pixels / rate : 1.0;
}

struct ViewRenderer::State {
  State(const Layers& layers, const Camera& camera_, std::optional<double> tolerance)
      : camera(camera_), foreground(layers.foreground, tolerance) {
    if (layers.background) background.emplace(*layers.background, tolerance);
  }

  void shade_row(const Scratch& scratch, int y, float* pixels) const {
    const FourCoordinates nothing{};
    const int width = scratch.foreground.width();
    const Texture* back = background ? &background->texture : nullptr;
    for (int x = 0; x < width; x += 4) {
      const FourCoordinates f = texture_coordinates(scratch.foreground, foreground.texture, y, x);
      const FourCoordinates b =
          back != nullptr ? texture_coordinates(scratch.background, *back, y, x) : nothing;
      for (int lane = 0; lane < 4; ++lane) {
        store4(pixels + 4 * (x + lane), composite(foreground.texture, back, f, b, lane));
      }
    }
  }

  /// Rows [y0, y1) of the view, which is drawn `factor` times as large.
  void render_band(const Projection& projection, int y0, int y1, int factor, Scratch& scratch, Image& out,
                   Image* coverage) const {
    const int width = out.width * factor;
    scratch.foreground.reset(width, y0 * factor, y1 * factor);
    draw_mesh(projection, foreground.mesh, foreground.projected, scratch.foreground);
    if (background) {
      scratch.background.reset(width, y0 * factor, y1 * factor);
      draw_mesh(projection, background->mesh, background->projected, scratch.background);
    }
    const std::size_t row_floats = 4 * (static_cast<std::size_t>(width) + 3);
    scratch.pixels.resize(2 * row_floats);
    float* const upper = scratch.pixels.data();
    float* const lower = upper + row_floats;
    for (int y = y0; y < y1; ++y) {
      shade_row(scratch, y * factor, upper);
      if (factor == 2) {
        shade_row(scratch, y * factor + 1, lower);
        average(upper, lower, out.width, upper);
      }
      write_row(upper, out.width, out.row(y), coverage != nullptr ? coverage->row(y) : nullptr);
    }
  }

  Camera camera;
  DrawableLayer foreground;
  std::optional<DrawableLayer> background;
  std::vector<Scratch> scratch;
};

ViewRenderer::ViewRenderer(const Layers& layers, const Camera& camera, std::optional<double> tolerance) {
  check_layers(layers);
  if (camera.width != layers.foreground.colour.width || camera.height != layers.foreground.colour.height) {
    throw Error(ErrorKind::kBadInput, "the camera is made for " + std::to_string(camera.width) + "x" +
                                          std::to_string(camera.height) + " pixels, the layers have " +
                                          std::to_string(layers.foreground.colour.width) + "x" +
                                          std::to_string(layers.foreground.colour.height));
  }
  state_ = std::make_unique<State>(layers, camera, tolerance);
}
ViewRenderer::~ViewRenderer() = default;
ViewRenderer::ViewRenderer(ViewRenderer&&) noexcept = default;
ViewRenderer& ViewRenderer::operator=(ViewRenderer&&) noexcept = default;

void ViewRenderer::render(const View& view, const RenderOptions& options, Image& out, Image* coverage) {
  State& s = *state_;
  const int width = options.width == 0 && options.height == 0 ? s.camera.width : options.width;
  const int height = options.width == 0 && options.height == 0 ? s.camera.height : options.height;
  const int factor = options.supersample ? 2 : 1;
  const int largest = kMaxViewSide / factor;
  if (width < 1 || height < 1 || width > largest || height > largest) {
    throw Error(ErrorKind::kUsage, "the view is to be " + std::to_string(width) + "x" +
                                       std::to_string(height) + ", outside 1x1 to " +
                                       std::to_string(largest) + "x" + std::to_string(largest));
  }
  fit(out, width, height, 3);
  if (coverage != nullptr) fit(*coverage, width, height, 1);
  const Projection projection = make_projection(s.camera, view, width * factor, height * factor);
  project_mesh(projection, s.foreground.mesh, s.foreground.projected);
  if (s.background) project_mesh(projection, s.background->mesh, s.background->projected);
  // About 20000 fragments of two layers, 16 bytes each, leave room for texels in a cache of 1 MiB.
  const int chosen = std::max(2, 20000 / (width * factor * factor));
  const int rows = options.band_rows > 0 ? options.band_rows : chosen;
  s.scratch.resize(static_cast<std::size_t>(thread_count()));
  parallel_for((height + rows - 1) / rows, [&](std::int64_t band) {
    const int y0 = static_cast<int>(band) * rows;
    s.render_band(projection, y0, std::min(y0 + rows, height), factor,
                  s.scratch[static_cast<std::size_t>(thread_index())], out, coverage);
  });
}

std::size_t ViewRenderer::triangle_count() const noexcept {
  return state_->foreground.mesh.triangle_count() +
         (state_->background ? state_->background->mesh.triangle_count() : 0);
}
const Mesh& ViewRenderer::foreground_mesh() const noexcept { return state_->foreground.mesh; }
const Mesh* ViewRenderer::background_mesh() const noexcept {
  return state_->background ? &state_->background->mesh : nullptr;
}

}  // namespace slide
