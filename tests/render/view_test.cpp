#include "render/view.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <random>

#include "render/camera_path.h"
#include "runtime/error.h"
#include "runtime/threads.h"

namespace slide {
namespace {

Image noise(int width, int height, int channels, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> value(0.0F, 1.0F);
  Image image(width, height, channels);
  for (float& v : image.data) v = value(random);
  return image;
}

Layers noise_layers(int width, int height, bool background) {
  Layers layers;
  layers.foreground = {noise(width, height, 3, 1), noise(width, height, 1, 2), noise(width, height, 1, 3)};
  if (background) layers.background = Layer{noise(width, height, 3, 4), noise(width, height, 1, 5), Image()};
  return layers;
}

/// Places as colours: red is u / 1024, green is v / 1024, so that a view tells where in the photo each pixel
/// is from.
Layer ramp(int width, int height, float disparity) {
  Layer layer{Image(width, height, 3), Image(width, height, 1, disparity), Image()};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      layer.colour.at(x, y, 0) = static_cast<float>(x) / 1024.0F;
      layer.colour.at(x, y, 1) = static_cast<float>(y) / 1024.0F;
    }
  }
  return layer;
}

View moved_view(double degrees, const glm::dvec3& axis, const glm::dvec3& translation, double zoom = 1.0) {
  View view;
  view.pose.rotation =
      glm::dmat3(glm::rotate(glm::dmat4(1.0), degrees * 3.14159265358979 / 180.0, glm::normalize(axis)));
  view.pose.translation = translation;
  view.zoom = zoom;
  return view;
}

Image rendered(const Layers& layers, const Camera& camera, const View& view,
               const RenderOptions& options = {}, std::optional<double> tolerance = std::nullopt,
               Image* coverage = nullptr) {
  ViewRenderer renderer(layers, camera, tolerance);
  Image out(1, 1, 3, std::numeric_limits<float>::quiet_NaN());
  renderer.render(view, options, out, coverage);
  return out;
}

double largest_difference(const Image& a, const Image& b) {
  REQUIRE(a.data.size() == b.data.size());
  double largest = 0.0;
  for (std::size_t i = 0; i < a.data.size(); ++i) {
    const double difference = std::abs(double(a.data[i]) - double(b.data[i]));
    largest = difference <= largest ? largest : difference;  // NaN gets through
  }
  return largest;
}

/// Where in the photo a view's pixel looks, on the plane of a disparity: by inverting the projection of the
/// plane.
glm::dvec2 place_in_photo(const Camera& camera, const View& view, double disparity, glm::dvec2 pixel) {
  const double f = camera.focal;
  const glm::dvec2 from_centre = pixel - camera.centre() - view.shift;
  const glm::dvec3 ray =
      glm::transpose(view.pose.rotation) *
      glm::dvec3(from_centre / (f * view.zoom), 1.0);  // from the view's centre, photo's axes
  const glm::dvec3 centre = -(glm::transpose(view.pose.rotation) * view.pose.translation);
  const double z = 1.0 / camera.inverse_depth(disparity);
  const glm::dvec3 point = centre + ray * ((z - centre.z) / ray.z);
  return camera.centre() + glm::dvec2(point.x, point.y) * (f / point.z);
}

/// Every pixel that looks at the inside of the photo is within 1/256 pixel of where geometry says.
void check_plane(const Camera& camera, const View& view, float disparity, std::optional<double> tolerance,
                 int least_pixels) {
  const Layers layers{ramp(camera.width, camera.height, disparity), std::nullopt};
  const Image out = rendered(layers, camera, view, {}, tolerance);
  double worst = 0.0;
  int pixels = 0;
  for (int y = 0; y < out.height; ++y) {
    for (int x = 0; x < out.width; ++x) {
      const glm::dvec2 place = place_in_photo(camera, view, double(disparity), {x, y});
      if (place.x < 0 || place.y < 0 || place.x > camera.width - 1 || place.y > camera.height - 1) continue;
      ++pixels;
      const glm::dvec2 seen{double(out.at(x, y, 0)) * 1024.0, double(out.at(x, y, 1)) * 1024.0};
      // Compared in the view, where subpixels are: both places projected.
      const auto in_view = [&](glm::dvec2 p) {
        return project(camera, view, back_project(camera, p.x, p.y, double(disparity)));
      };
      const glm::dvec2 apart = in_view(seen) - in_view(place);
      worst = std::max({worst, std::abs(apart.x), std::abs(apart.y)});
    }
  }
  CHECK(worst <= 1.0 / 256.0);
  CHECK(pixels >= least_pixels);
}

}  // namespace

TEST_CASE("the identity gives back the photo, whatever the disparity") {
  for (const auto& size : {std::pair{37, 29}, {1, 1}, {1, 9}, {8, 1}, {2, 2}}) {
    const int width = size.first;
    const int height = size.second;
    CAPTURE(width);
    CAPTURE(height);
    const Layers layers = noise_layers(width, height, false);
    const Camera camera = make_camera(width, height);
    Image coverage;
    for (const std::optional<double> tolerance : {std::optional<double>(), std::optional<double>(0.0)}) {
      const Image out = rendered(layers, camera, View{}, {}, tolerance, &coverage);
      CHECK(largest_difference(out, layers.foreground.colour) <= 1e-4);
      CHECK(std::all_of(coverage.data.begin(), coverage.data.end(), [](float c) { return c == 1.0F; }));
    }
  }
}

TEST_CASE("the identity gives back the widest photo within 1/255") {
  const Layers layers = noise_layers(kMaxLayerSide, 2, false);
  const Image out = rendered(layers, make_camera(kMaxLayerSide, 2), View{});
  CHECK(largest_difference(out, layers.foreground.colour) <= 1.0 / 255.0);
}

TEST_CASE("two layers are composited by the foreground's alpha, eq. 4") {
  const Layers layers = noise_layers(23, 17, true);
  const Image out = rendered(layers, make_camera(23, 17), View{});
  Image expected = layers.foreground.colour;
  for (int y = 0; y < 17; ++y) {
    for (int x = 0; x < 23; ++x) {
      const float a = layers.foreground.alpha.at(x, y);
      for (int c = 0; c < 3; ++c) {
        expected.at(x, y, c) = a * expected.at(x, y, c) + (1 - a) * layers.background->colour.at(x, y, c);
      }
    }
  }
  CHECK(largest_difference(out, expected) <= 1e-4);
}

TEST_CASE("where the foreground does not reach, the background is seen alone, and black beyond it") {
  const int width = 40;
  const Camera camera = make_camera(width, 8);
  Layers layers;
  layers.foreground = {Image(width, 8, 3, 1.0F), Image(width, 8, 1, 1.0F), Image()};
  layers.background = Layer{Image(width, 8, 3, 0.5F), Image(width, 8, 1, 0.0F), Image()};
  View view;
  view.pose.translation.x = 20.0 / camera.focal;  // near moves by 20 pixels to the right, far by 2
  Image coverage;
  const Image out = rendered(layers, camera, view, {}, std::nullopt, &coverage);
  for (int x = 0; x < width; ++x) {
    const float expected = x >= 20 ? 1.0F : (x >= 2 ? 0.5F : 0.0F);
    CHECK(out.at(x, 4, 1) == doctest::Approx(expected));
    CHECK(coverage.at(x, 4) == (x >= 2 ? 1.0F : 0.0F));
  }
}

TEST_CASE("the nearer surface hides the farther one that it moves across") {
  const int width = 60;
  const Camera camera = make_camera(width, 6);
  Layers layers;
  layers.foreground = {Image(width, 6, 3, 0.2F), Image(width, 6, 1, 0.0F), Image()};
  for (int y = 0; y < 6; ++y) {
    for (int x = 20; x < 30; ++x) {
      layers.foreground.disparity.at(x, y) = 1.0F;
      layers.foreground.colour.at(x, y, 0) = 0.9F;
    }
  }
  for (const double direction : {-1.0, 1.0}) {
    View view;
    view.pose.translation.x = direction * 10.5 / camera.focal;
    const Image out = rendered(layers, camera, view);
    const int start = direction > 0 ? 31 : 10;  // vertices 20 to 29 land at 30.5 to 39.5, or 9.5 to 18.5
    for (int x = start; x < start + 9; ++x) CHECK(out.at(x, 3, 0) == doctest::Approx(0.9));
    CHECK(out.at(direction > 0 ? 41 : 51, 3, 0) == doctest::Approx(0.2));
    CHECK(out.at(direction > 0 ? 5 : 8, 3, 0) == doctest::Approx(0.2));
  }
}

TEST_CASE("a plane moves by focal length times translation over depth, to 1/256 pixel") {
  const Camera camera = make_camera(96, 70);
  for (const double pixels : {0.3, 4.71, -7.123}) {
    for (const float disparity : {0.0F, 0.4F, 1.0F}) {
      View view;
      view.pose.translation = {pixels / camera.focal, -0.37 * pixels / camera.focal, 0.0};
      const double shift = pixels * camera.inverse_depth(double(disparity));
      // The closed form of place_in_photo() for this view.
      CHECK(place_in_photo(camera, view, double(disparity), {50, 40}).x == doctest::Approx(50 - shift));
      check_plane(camera, view, disparity, std::nullopt, 80 * 60);
      check_plane(camera, view, disparity, 0.0, 80 * 60);
    }
  }
}

TEST_CASE("a plane seen obliquely is textured in perspective, to 1/256 pixel") {
  const Camera camera = make_camera(130, 90, 70.0);
  // With the adaptive mesh a triangle spans 64 pixels: interpolation without perspective would be off by
  // pixels.
  for (const std::optional<double> tolerance : {std::optional<double>(), std::optional<double>(0.0)}) {
    check_plane(camera, moved_view(30.0, {0, 1, 0}, {0.1, 0.0, 0.2}), 0.7F, tolerance, 3000);
    check_plane(camera, moved_view(-20.0, {1, 0.5, 0}, {0.0, 0.2, -0.3}), 1.0F, tolerance, 3000);
    check_plane(camera, moved_view(65.0, {0, 0.2, 1}, {0.3, 0.0, -0.4}, 1.5), 0.2F, tolerance, 3000);
  }
}

TEST_CASE("the edges of a checkerboard land where projective geometry says") {
  const int width = 128;
  const Camera camera = make_camera(width, 96, 60.0);
  Layers layers{{Image(width, 96, 3), Image(width, 96, 1, 0.6F), Image()}, std::nullopt};
  for (int y = 0; y < 96; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < 3; ++c)
        layers.foreground.colour.at(x, y, c) = ((x / 16 + y / 16) & 1) != 0 ? 1.0F : 0.0F;
    }
  }
  const View view = moved_view(12.0, {0, 1, 0}, {-0.2, 0.0, -0.25});
  constexpr double kScale = 4.0;
  const Image out = rendered(layers, camera, view, {4 * width, 4 * 96});
  // The vertical edges, where the texture is 1/2 between pixels 16 k - 1 and 16 k, along the row that the
  // board's horizontal centre line (which this view leaves horizontal) is seen on; between them the picture
  // is monotone.
  const int row = out.height / 2;
  const double photo_row = (row - (out.height - 1) / 2.0) / kScale + 95 / 2.0;
  int edges = 0;
  for (int k = 2; k <= 6; ++k) {
    const double edge = 16.0 * k - 0.5;
    // Down the edge, the place that is seen on this row.
    double v = photo_row;
    for (int i = 0; i < 50; ++i) {
      v += photo_row - project(camera, view, back_project(camera, edge, v, 0.6)).y;
    }
    const double place = project(camera, view, back_project(camera, edge, v, 0.6)).x;
    const double expected = (place - 127 / 2.0) * kScale + (out.width - 1) / 2.0;
    const int left = static_cast<int>(std::floor(expected));
    const double a = double(out.at(left, row, 0)) - 0.5;
    const double b = double(out.at(left + 1, row, 0)) - 0.5;
    REQUIRE(a * b < 0.0);
    CHECK(std::abs(left + a / (a - b) - expected) <= 1.0 / 256.0);
    ++edges;
  }
  CHECK(edges == 5);
}

TEST_CASE("the photo seen from its own place is not bent, at any size and whatever its relief") {
  // Triangles that recede from the camera, of up to 64 pixels with the adaptive mesh: were their texture
  // linear in space and not as the photo projects, it would be off by many pixels inside them.
  const int width = 129;
  const int height = 97;
  const Camera camera = make_camera(width, height);
  Layers layers{ramp(width, height, 0.0F), std::nullopt};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x)
      layers.foreground.disparity.at(x, y) = static_cast<float>(4 * x + 3 * y) / 1024.0F;
  }
  for (const std::optional<double> tolerance : {std::optional<double>(), std::optional<double>(0.0)}) {
    const Image out = rendered(layers, camera, View{}, {3 * width, 3 * height}, tolerance);
    double worst = 0.0;
    for (int y = 1; y < out.height - 1; ++y) {
      for (int x = 1; x < out.width - 1; ++x) {
        worst = std::max({worst, std::abs(double(out.at(x, y, 0)) * 1024.0 - (x - 1) / 3.0),
                          std::abs(double(out.at(x, y, 1)) * 1024.0 - (y - 1) / 3.0)});
      }
    }
    CHECK(worst <= 1e-3);
  }
}

TEST_CASE("a view of another size is the same picture scaled about its centre") {
  const Camera camera = make_camera(64, 48);
  const Layers layers{ramp(64, 48, 0.5F), std::nullopt};
  const Image wide = rendered(layers, camera, View{}, {192, 144});
  const Image cropped = rendered(layers, camera, View{}, {64, 20});
  for (const int x : {10, 95, 180}) {
    CHECK(double(wide.at(x, 71, 0)) * 1024 == doctest::Approx((x - 95.5) / 3 + 31.5).epsilon(1e-4));
  }
  for (const int y : {0, 9, 19}) {
    CHECK(double(cropped.at(30, y, 1)) * 1024 == doctest::Approx((y - 9.5) + 23.5).epsilon(1e-4));
  }
}

TEST_CASE("supersampling is the mean of four pixels of the view at twice the size") {
  const Layers layers = noise_layers(33, 21, true);
  const Camera camera = make_camera(33, 21);
  const View view = moved_view(3.0, {0.3, 1, 0}, {0.05, 0.02, 0.1});
  const Image large = rendered(layers, camera, view, {66, 42});
  const Image out = rendered(layers, camera, view, {33, 21, true});
  Image expected(33, 21, 3);
  for (int y = 0; y < 21; ++y) {
    for (int x = 0; x < 33; ++x) {
      for (int c = 0; c < 3; ++c) {
        expected.at(x, y, c) = (large.at(2 * x, 2 * y, c) + large.at(2 * x + 1, 2 * y, c) +
                                large.at(2 * x, 2 * y + 1, c) + large.at(2 * x + 1, 2 * y + 1, c)) /
                               4.0F;
      }
    }
  }
  CHECK(largest_difference(out, expected) <= 1e-6);
}

TEST_CASE("a view has the same bytes at any thread count and band size") {
  const Layers layers = noise_layers(45, 30, true);
  const Camera camera = make_camera(45, 30);
  const View through =
      moved_view(10.0, {0.3, 1, 0.2}, {0.1, 0.02, -1.4});  // parts of it behind the clip plane
  const View beside = moved_view(2.0, {0.3, 1, 0.2}, {0.1, 0.02, 0.0});
  for (const std::optional<double> tolerance : {std::optional<double>(), std::optional<double>(0.3)}) {
    ViewRenderer renderer(layers, camera, tolerance);
    for (const View& view : {beside, through}) {
      for (const bool supersample : {false, true}) {
        Image one;
        set_thread_count(1);
        renderer.render(view, {45, 30, supersample, 30}, one);
        for (const auto& [threads, band_rows] : {std::pair{1, 1}, {2, 0}, {2, 3}, {5, 1}, {5, 7}}) {
          Image many(45, 30, 3, std::numeric_limits<float>::quiet_NaN());
          set_thread_count(threads);
          renderer.render(view, {45, 30, supersample, band_rows}, many);
          CHECK(std::memcmp(one.data.data(), many.data.data(), one.data.size() * sizeof(float)) == 0);
        }
      }
    }
  }
  set_thread_count(0);
}

TEST_CASE("a renderer draws view after view, of any size, as a new one would") {
  const Layers layers = noise_layers(30, 20, true);
  const Camera camera = make_camera(30, 20);
  ViewRenderer renderer(layers, camera);
  Image out;
  for (const RenderOptions& options :
       {RenderOptions{}, RenderOptions{61, 45}, RenderOptions{5, 40, true}, RenderOptions{}}) {
    const View view = moved_view(4.0, {0, 1, 0}, {0.02 * options.width, 0.0, 0.0});
    renderer.render(view, options, out);
    CHECK(largest_difference(out, rendered(layers, camera, view, options)) == 0.0);
  }
}

TEST_CASE("the adaptive mesh's view of a smooth scene is the full mesh's within its tolerance") {
  const int width = 150;
  const int height = 110;
  const Camera camera = make_camera(width, height);
  Layers layers{ramp(width, height, 0.0F), std::nullopt};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      layers.foreground.disparity.at(x, y) =
          static_cast<float>(0.5 + 0.2 * std::sin(x / 40.0) * std::cos(y / 30.0));
    }
  }
  const std::vector<View> views = make_path(camera, PathOptions{PathKind::kCircle, 4.0, 0.5, 5});
  const double tolerance = mesh_tolerance(camera, views, 0.1);
  CHECK(tolerance == doctest::Approx(0.1 / (0.04 * width)).epsilon(1e-5));
  ViewRenderer full(layers, camera);
  ViewRenderer adaptive(layers, camera, tolerance);
  CHECK(adaptive.triangle_count() * 4 < full.triangle_count());
  Image a;
  Image b;
  for (const View& view : views) {
    full.render(view, {}, a);
    adaptive.render(view, {}, b);
    double worst = 0.0;
    // Away from the outline, where the two may differ in what they cover. A point displaced by 0.1 pixel in
    // the view shows what is at most 0.1 / (1 - 0.045) pixel away in the photo: the relief stretches the
    // picture by up to 6 pixels of parallax times 0.0075 of disparity per pixel.
    for (int y = 8; y < height - 8; ++y) {
      for (int x = 8; x < width - 8; ++x) {
        for (int c = 0; c < 2; ++c) {
          worst = std::max(worst, std::abs(double(a.at(x, y, c)) - double(b.at(x, y, c))) * 1024.0);
        }
      }
    }
    CHECK(worst <= 0.1 / (1 - 0.045) + 2.0 / 256);
    CHECK(worst > 0.0);
  }
}

TEST_CASE("layers with NaN or infinite disparity and cameras of another size are refused") {
  Layers layers = noise_layers(8, 6, true);
  CHECK_THROWS_AS(ViewRenderer(layers, make_camera(8, 7)), Error);
  layers.background->disparity.at(3, 2) = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_WITH_AS(ViewRenderer(layers, make_camera(8, 6)), doctest::Contains("pixel (3, 2)"), Error);
  layers.background->disparity.at(3, 2) = std::numeric_limits<float>::infinity();
  CHECK_THROWS_AS(ViewRenderer(layers, make_camera(8, 6)), Error);
}

TEST_CASE("views of impossible sizes are refused") {
  ViewRenderer renderer(noise_layers(8, 6, false), make_camera(8, 6));
  Image out;
  CHECK_THROWS_AS(renderer.render(View{}, {-1, 5}, out), Error);
  CHECK_THROWS_AS(renderer.render(View{}, {5, 0}, out), Error);
  CHECK_THROWS_AS(renderer.render(View{}, {kMaxViewSide + 1, 1}, out), Error);
  CHECK_THROWS_AS(renderer.render(View{}, {kMaxViewSide, 1, true}, out), Error);
}

}  // namespace slide
