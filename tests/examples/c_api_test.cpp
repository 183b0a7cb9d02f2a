#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "examples/c_api/slide.h"
#include "render/write_image.h"
#include "tests/temporary_folder.h"

namespace {

constexpr int kWidth = 48;
constexpr int kHeight = 32;

/// A checkered wall behind a disc.
struct Scene {
  Scene() : rgb(std::size_t{3} * kWidth * kHeight), disparity(std::size_t{kWidth} * kHeight) {
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const bool disc = (x - 24) * (x - 24) + (y - 16) * (y - 16) < 80;
        const std::size_t i = static_cast<std::size_t>(y) * kWidth + static_cast<std::size_t>(x);
        disparity[i] = disc ? 1.0F : 0.0F;
        rgb[3 * i] = disc ? 0.9F : 0.1F;
        rgb[3 * i + 1] = (x / 8 + y / 8) % 2 == 0 ? 0.6F : 0.3F;
        rgb[3 * i + 2] = static_cast<float>(x) / kWidth;
      }
  }
  std::vector<float> rgb, disparity;
};

slide_settings settings_without_weights() {
  slide_settings settings;
  slide_settings_init(&settings);
  settings.inpaint_weights = "formula";
  settings.depth_weights = "formula";
  settings.frames = 3;
  return settings;
}

/// A photo that is freed at the end of the test.
struct Photo {
  Photo() = default;
  Photo(const Photo&) = delete;
  Photo& operator=(const Photo&) = delete;
  ~Photo() { slide_free(photo); }
  slide_photo* photo = nullptr;
};

slide_status create(const Scene& scene, const slide_settings& settings, Photo& photo) {
  return slide_create(scene.rgb.data(), scene.disparity.data(), kWidth, kHeight, &settings, &photo.photo);
}

bool message_has(const std::string& part) {
  return std::string(slide_last_error()).find(part) != std::string::npos;
}

}  // namespace

// At an outline A < 1, so that what lies behind shows through by eq. 4: the foreground layer alone is the
// photo there (tests/render), its sum with the background is not. The disc has a radius of 8.9 pixels; the
// maxpool makes it one wider, the gradient of A reaches one further on each side.
TEST_CASE("C API: the view of the camera that took the photo is the photo, within 1/255 off the outline") {
  const Scene scene;
  Photo photo;
  REQUIRE(create(scene, settings_without_weights(), photo) == SLIDE_OK);
  CHECK(std::string(slide_last_error()).empty());
  int width = 0;
  int height = 0;
  REQUIRE(slide_size(photo.photo, &width, &height) == SLIDE_OK);
  CHECK(width == kWidth);
  CHECK(height == kHeight);
  std::vector<float> view(scene.rgb.size() + 1, std::numeric_limits<float>::quiet_NaN());
  REQUIRE(slide_render(photo.photo, 0, 0, 0, 0, 0, view.data()) == SLIDE_OK);
  const auto at_outline = [](std::size_t pixel) {
    const double distance =
        std::hypot(static_cast<double>(pixel % kWidth) - 24, static_cast<double>(pixel / kWidth) - 16);
    return distance > 7.5 && distance < 11.5;
  };
  for (std::size_t i = 0; i < scene.rgb.size(); ++i) {
    CAPTURE(i);
    if (!at_outline(i / 3)) REQUIRE(std::abs(view[i] - scene.rgb[i]) <= 1.0 / 255);
  }
  CHECK(std::isnan(view.back()));
}

TEST_CASE("C API: a camera that is moved sees near things shifted, at any size of the view") {
  const Scene scene;
  Photo photo;
  REQUIRE(create(scene, settings_without_weights(), photo) == SLIDE_OK);
  // Depth 1 and f = width / (2 tan(fov / 2)) = 48 pixels at the default 53.13 degrees: the disc moves left by
  // 48 · 0.1 pixels, so that its left edge, at x = 24 - 8.9, comes to x = 10.3.
  std::vector<float> view(scene.rgb.size());
  REQUIRE(slide_render(photo.photo, 0.1, 0, 0, 0, 0, view.data()) == SLIDE_OK);
  const auto red = [&](int x) { return view[3 * (16 * std::size_t{kWidth} + static_cast<std::size_t>(x))]; };
  CHECK(scene.rgb[3 * (16 * std::size_t{kWidth} + 12)] == doctest::Approx(0.1));
  CHECK(red(12) == doctest::Approx(0.9).epsilon(0.02));
  CHECK(red(7) == doctest::Approx(0.1).epsilon(0.1));
  std::vector<float> small(std::size_t{3} * 24 * 16 + 1, std::numeric_limits<float>::quiet_NaN());
  REQUIRE(slide_render(photo.photo, 0, 0, 0, 24, 16, small.data()) == SLIDE_OK);
  CHECK(!std::isnan(small[small.size() - 2]));
  CHECK(std::isnan(small.back()));
  CHECK(slide_render(photo.photo, 0, 0, 0, -24, 16, small.data()) == SLIDE_USAGE);
  CHECK(slide_render(photo.photo, std::numeric_limits<double>::infinity(), 0, 0, 24, 16, small.data()) ==
        SLIDE_USAGE);
}

TEST_CASE("C API: fill stands for no network, not for a file") {
  const Scene scene;
  slide_settings settings = settings_without_weights();
  settings.inpaint_weights = "fill";
  Photo photo;
  CHECK(create(scene, settings, photo) == SLIDE_OK);
  settings.inpaint_weights = "fill.safetensors";
  Photo none;
  CHECK(create(scene, settings, none) == SLIDE_BAD_WEIGHTS);
}

TEST_CASE("C API: a photo comes from a file and becomes a page") {
  const TemporaryFolder folder;
  const Scene scene;
  slide::Image image(kWidth, kHeight, 3);
  image.data.assign(scene.rgb.begin(), scene.rgb.end());
  slide::write_png(folder.file("photo.png"), image);
  const slide_settings settings = settings_without_weights();
  Photo photo;
  REQUIRE_MESSAGE(slide_open(folder.file("photo.png").c_str(), &settings, &photo.photo) == SLIDE_OK,
                  slide_last_error());
  REQUIRE(slide_export(photo.photo, folder.file("photo.html").c_str()) == SLIDE_OK);
  CHECK(bytes_of_file(folder.file("photo.html")).size() > 5000);
  CHECK(slide_export(photo.photo, folder.file("photo.doc").c_str()) == SLIDE_USAGE);
  CHECK(message_has("photo.doc"));
  // Neither its own file nor another program's is replaced.
  CHECK(slide_export(photo.photo, folder.file("photo.png").c_str()) == SLIDE_USAGE);
  write_bytes(folder.file("other.gif"), std::as_bytes(std::span("of somebody else", 16)));
  CHECK(slide_export(photo.photo, folder.file("other.gif").c_str()) == SLIDE_USAGE);
  CHECK(message_has("other.gif"));
  slide_settings overwriting = settings;
  overwriting.overwrite = 1;
  Photo second;
  REQUIRE(slide_open(folder.file("photo.png").c_str(), &overwriting, &second.photo) == SLIDE_OK);
  CHECK(slide_export(second.photo, folder.file("photo.png").c_str()) == SLIDE_USAGE);
  CHECK(slide_export(second.photo, folder.file("other.gif").c_str()) == SLIDE_OK);
  CHECK(folder.entries() == 3);
}

TEST_CASE("C API: wrong arguments are refused with a message") {
  const Scene scene;
  slide_settings settings = settings_without_weights();
  Photo photo;
  CHECK(slide_create(nullptr, nullptr, kWidth, kHeight, &settings, &photo.photo) == SLIDE_USAGE);
  CHECK(message_has("NULL"));
  CHECK(slide_create(scene.rgb.data(), nullptr, kWidth, kHeight, nullptr, &photo.photo) == SLIDE_USAGE);
  CHECK(message_has("slide_settings_init"));
  CHECK(slide_create(scene.rgb.data(), nullptr, kWidth, kHeight, &settings, nullptr) == SLIDE_USAGE);
  CHECK(slide_open(nullptr, &settings, &photo.photo) == SLIDE_USAGE);
  CHECK(slide_size(nullptr, nullptr, nullptr) == SLIDE_USAGE);
  CHECK(slide_render(nullptr, 0, 0, 0, 0, 0, nullptr) == SLIDE_USAGE);
  CHECK(slide_export(nullptr, "x.html") == SLIDE_USAGE);
  slide_free(nullptr);
  slide_settings other = settings;
  other.struct_size -= sizeof(void*);
  CHECK(create(scene, other, photo) == SLIDE_USAGE);
  other = settings;
  other.frames = 0;
  CHECK(create(scene, other, photo) == SLIDE_USAGE);
  CHECK(!message_has("internal"));
  other = settings;
  other.parallax_percent = std::numeric_limits<double>::quiet_NaN();
  CHECK(create(scene, other, photo) == SLIDE_USAGE);
  other = settings;
  other.near_depth = 20;
  CHECK(create(scene, other, photo) == SLIDE_USAGE);
  other = settings;
  other.max_side = 0;
  CHECK(create(scene, other, photo) == SLIDE_USAGE);
  CHECK(photo.photo == nullptr);
}

TEST_CASE("C API: bad images, bad files, bad weights and too little memory have their own status") {
  const TemporaryFolder folder;
  Scene scene;
  slide_settings settings = settings_without_weights();
  Photo photo;
  CHECK(slide_create(scene.rgb.data(), nullptr, -1, kHeight, &settings, &photo.photo) == SLIDE_BAD_INPUT);
  write_bytes(folder.file("x.jpg"), std::as_bytes(std::span("no photo", 8)));
  CHECK(slide_open(folder.file("x.jpg").c_str(), &settings, &photo.photo) == SLIDE_BAD_INPUT);
  CHECK(message_has("x.jpg"));
  CHECK(slide_open(folder.file("none.jpg").c_str(), &settings, &photo.photo) == SLIDE_BAD_INPUT);
  const std::string weights = folder.file("x.jpg");
  slide_settings other = settings;
  other.inpaint_weights = weights.c_str();
  CHECK(create(scene, other, photo) == SLIDE_BAD_WEIGHTS);
  other = settings;
  other.memory_limit = 1;
  CHECK(create(scene, other, photo) == SLIDE_OUT_OF_MEMORY);
  scene.disparity[3] = std::numeric_limits<float>::quiet_NaN();
  CHECK(create(scene, settings, photo) == SLIDE_BAD_INPUT);
  CHECK(message_has("(3, 0)"));
  scene.disparity[3] = 0;
  scene.rgb[3 * 5] = std::numeric_limits<float>::infinity();
  CHECK(create(scene, settings, photo) == SLIDE_BAD_INPUT);
  CHECK(photo.photo == nullptr);
}

TEST_CASE("C API: the progress callback is given its pointer, and can stop the work") {
  const Scene scene;
  slide_settings settings = settings_without_weights();
  struct Calls {
    int allowed, made;
  } calls{1000000, 0};
  settings.user = &calls;
  settings.progress = [](void* user, const char* stage, double part) {
    auto& c = *static_cast<Calls*>(user);
    CHECK(stage != nullptr);
    CHECK(part >= 0);
    CHECK(part <= 1);
    return c.made++ < c.allowed ? 1 : 0;
  };
  {
    Photo photo;
    REQUIRE(create(scene, settings, photo) == SLIDE_OK);
    CHECK(calls.made > 2);
  }
  calls = {1, 0};
  Photo photo;
  CHECK(create(scene, settings, photo) == SLIDE_CANCELLED);
  CHECK(calls.made == 2);
  CHECK(photo.photo == nullptr);
  CHECK(!std::string(slide_last_error()).empty());
}
