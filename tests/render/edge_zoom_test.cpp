#include "render/edge_zoom.h"

#include <doctest/doctest.h>

#include "render/camera_path.h"
#include "render/view.h"

using namespace slide;

TEST_CASE("a still camera needs no zoom") {
  CHECK(edge_zoom(make_camera(64, 48), {View{}}) == doctest::Approx(1.0));
}

TEST_CASE("a swing about the middle disparity needs the zoom that its border's shift asks for") {
  // Disparity 0 and 1 move P/2 apart from the one that stands still: the border comes in by P/2 pixels at
  // most.
  const Camera camera = make_camera(200, 100);
  const auto views =
      make_path(camera, {.kind = PathKind::kSwing, .parallax_percent = 4, .focus = 0.5, .frames = 8});
  CHECK(edge_zoom(camera, views) == doctest::Approx(100.0 / (100.0 - 4.0)).epsilon(1e-3));
}

TEST_CASE("with the zoom no view shows anything but the photo, whatever its relief") {
  Layers layers;
  layers.foreground.colour = Image(120, 80, 3, 0.5F);
  layers.foreground.disparity = Image(120, 80, 1);
  for (int y = 0; y < 80; ++y)
    for (int x = 0; x < 120; ++x)
      layers.foreground.disparity.at(x, y) = static_cast<float>((x / 30 + y / 20) % 2);
  const Camera camera = make_camera(120, 80);
  for (const PathKind kind : {PathKind::kCircle, PathKind::kSwing}) {
    auto views = make_path(camera, {.kind = kind, .parallax_percent = 5, .focus = 0.3, .frames = 12});
    ViewRenderer renderer(layers, camera);
    Image frame;
    Image coverage;
    double bare = 0;
    for (const View& view : views) {
      renderer.render(view, {}, frame, &coverage);
      for (const float c : coverage.data) bare += 1.0 - static_cast<double>(c);
    }
    CHECK(bare > 0);
    for (const View& view : without_edges(camera, views)) {
      renderer.render(view, {}, frame, &coverage);
      for (const float c : coverage.data) REQUIRE(c == 1.0F);
    }
  }
}

TEST_CASE("what a path leaves of the photo is what the far plane's shift leaves") {
  // With disparity 1 standing still, disparity 0 moves by P at both ends of a swing: half of the width.
  const Camera camera = make_camera(200, 100);
  const auto coverage = [&](PathKind kind, double parallax, double focus) {
    return least_coverage(
        camera, make_path(camera, {.kind = kind, .parallax_percent = parallax, .focus = focus, .frames = 8}));
  };
  CHECK(least_coverage(camera, {View{}}) == 1);
  CHECK(coverage(PathKind::kSwing, 50, 1) == doctest::Approx(0.5));
  CHECK(coverage(PathKind::kSwing, 25, 0) == doctest::Approx(0.75));
  CHECK(coverage(PathKind::kCircle, 50, 1) == 0);  // half of the width is all of the height
  CHECK(least_coverage(camera, without_edges(camera, make_path(camera, {.parallax_percent = 4}))) == 1);
}
