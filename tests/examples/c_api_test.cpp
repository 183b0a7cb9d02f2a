#include <doctest/doctest.h>
#include <slide/slide.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "render/write_image.h"
#include "tests/examples/program.h"
#include "tests/temporary_folder.h"

namespace {

constexpr int kWidth = 48;
constexpr int kHeight = 32;
constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// A checkered wall behind a disc.
struct Scene {
  Scene() : rgb(3 * kPixels), disparity(kPixels) {
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
  [[nodiscard]] slide_image colours() const { return {rgb.data(), kWidth, kHeight, 3, SLIDE_FLOAT32, 0}; }
  [[nodiscard]] slide_image map() const { return {disparity.data(), kWidth, kHeight, 1, SLIDE_FLOAT32, 0}; }
  std::vector<float> rgb, disparity;
};

/// Networks of made-up weights.
slide_settings small_settings() {
  slide_settings settings;
  slide_settings_init(&settings, sizeof settings);
  settings.inpaint_weights = "formula";
  settings.depth_weights = "formula";
  settings.depth_side = 64;
  return settings;
}

slide_scene short_path() {
  slide_scene scene;
  slide_scene_init(&scene, sizeof scene);
  scene.frames = 3;
  return scene;
}

/// Freed at the end of the test.
struct Model {
  explicit Model(const slide_settings& settings = small_settings()) {
    status = slide_model_create(&settings, &model);
  }
  Model(const Model&) = delete;
  Model& operator=(const Model&) = delete;
  ~Model() { slide_model_free(model); }
  slide_model* model = nullptr;
  slide_status status;
};

struct Photo {
  Photo() = default;
  Photo(const Photo&) = delete;
  Photo& operator=(const Photo&) = delete;
  ~Photo() { slide_photo_free(photo); }
  slide_photo* photo = nullptr;
};

slide_status make(const Model& model, const Scene& scene, Photo& photo,
                  const slide_scene& path = short_path()) {
  const slide_image colours = scene.colours();
  const slide_image map = scene.map();
  return slide_make(model.model, &colours, &map, nullptr, &path, &photo.photo);
}

slide_buffer buffer_of(std::vector<float>& values, int width, int height, int channels) {
  return {values.data(), width, height, channels, SLIDE_FLOAT32, 0};
}

bool message_has(const std::string& part) {
  return std::string(slide_last_error()).find(part) != std::string::npos;
}

/// The disparity of a photo by the network.
std::vector<float> depth_of(const Model& model, const slide_image& image) {
  std::vector<float> map(static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height),
                         kNan);
  const slide_buffer buffer = buffer_of(map, image.width, image.height, 1);
  REQUIRE_MESSAGE(slide_disparity(model.model, &image, &buffer) == SLIDE_OK, slide_last_error());
  return map;
}

}  // namespace

// At an outline A < 1, so that what lies behind shows through by eq. 4: the foreground layer alone is the
// photo there (tests/render), its sum with the background is not. The disc has a radius of 8.9 pixels; the
// maxpool makes it one wider, the gradient of A reaches one further on each side.
TEST_CASE("C API: the view of the camera that took the photo is the photo, within 1/255 off the outline") {
  const Scene scene;
  const Model model;
  REQUIRE_MESSAGE(model.status == SLIDE_OK, slide_last_error());
  Photo photo;
  REQUIRE(make(model, scene, photo) == SLIDE_OK);
  CHECK(std::string(slide_last_error()).empty());
  int width = 0;
  int height = 0;
  REQUIRE(slide_photo_size(photo.photo, &width, &height) == SLIDE_OK);
  CHECK(width == kWidth);
  CHECK(height == kHeight);
  std::vector<float> view(scene.rgb.size() + 1, kNan);
  const slide_buffer buffer = buffer_of(view, kWidth, kHeight, 3);
  const slide_view identity = slide_view_at(0, 0, 0);
  REQUIRE(slide_render(photo.photo, &identity, &buffer) == SLIDE_OK);
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
  const Model model;
  Photo photo;
  REQUIRE(make(model, scene, photo) == SLIDE_OK);
  // Depth 1 and f = width / (2 tan(fov / 2)) = 48 pixels at the default 53.13 degrees: the disc moves left by
  // 48 · 0.1 pixels, so that its left edge, at x = 24 - 8.9, comes to x = 10.3.
  std::vector<float> view(scene.rgb.size());
  const slide_buffer buffer = buffer_of(view, kWidth, kHeight, 3);
  slide_view right = slide_view_at(0.1, 0, 0);
  REQUIRE(slide_render(photo.photo, &right, &buffer) == SLIDE_OK);
  const auto red = [&](int x) { return view[3 * (16 * std::size_t{kWidth} + static_cast<std::size_t>(x))]; };
  CHECK(scene.rgb[3 * (16 * std::size_t{kWidth} + 12)] == doctest::Approx(0.1));
  CHECK(red(12) == doctest::Approx(0.9).epsilon(0.02));
  CHECK(red(7) == doctest::Approx(0.1).epsilon(0.1));
  // Half a turn about z, given by rows, shows the picture upside down: the disc stays, blue runs backwards.
  slide_view turned = slide_view_at(0, 0, 0);
  turned.rotation[0] = turned.rotation[4] = -1;
  REQUIRE(slide_render(photo.photo, &turned, &buffer) == SLIDE_OK);
  CHECK(view[3 * 5 + 2] == doctest::Approx(static_cast<double>(kWidth - 1 - 5) / kWidth).epsilon(0.05));
  turned.rotation[0] = 2;
  CHECK(slide_render(photo.photo, &turned, &buffer) == SLIDE_USAGE);
  CHECK(message_has("rotation"));

  std::vector<float> small(std::size_t{3} * 24 * 16 + 1, kNan);
  slide_buffer little = buffer_of(small, 24, 16, 3);
  const slide_view identity = slide_view_at(0, 0, 0);
  REQUIRE(slide_render(photo.photo, &identity, &little) == SLIDE_OK);
  CHECK(!std::isnan(small[small.size() - 2]));
  CHECK(std::isnan(small.back()));
  little.width = -24;
  CHECK(slide_render(photo.photo, &identity, &little) == SLIDE_USAGE);
  right.translation[0] = std::numeric_limits<double>::infinity();
  CHECK(slide_render(photo.photo, &right, &buffer) == SLIDE_USAGE);
}

TEST_CASE("C API: bytes and floats, grey and RGBA, with and without gaps between rows are the same image") {
  const Model model;
  // Values that bytes hold exactly.
  std::vector<unsigned char> bytes(3 * kPixels);
  std::vector<float> floats(3 * kPixels);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] = static_cast<unsigned char>(i * 7919 % 256);
    floats[i] = static_cast<float>(bytes[i]) / 255;
  }
  const std::vector<float> expected = depth_of(model, {floats.data(), kWidth, kHeight, 3, SLIDE_FLOAT32, 0});
  CHECK(*std::max_element(expected.begin(), expected.end()) == doctest::Approx(1).epsilon(0.02));
  CHECK(depth_of(model, {bytes.data(), kWidth, kHeight, 3, SLIDE_UINT8, 0}) == expected);
  // Four channels, five more bytes a row.
  constexpr std::size_t kRow = 4 * kWidth + 5;
  std::vector<unsigned char> gaps(kRow * kHeight, 99);
  for (std::size_t y = 0; y < kHeight; ++y)
    for (std::size_t x = 0; x < kWidth; ++x)
      std::memcpy(&gaps[y * kRow + 4 * x], &bytes[3 * (y * kWidth + x)], 3);
  CHECK(depth_of(model, {gaps.data(), kWidth, kHeight, 4, SLIDE_UINT8, kRow}) == expected);
  // Grey is its own red, green and blue.
  std::vector<float> grey(kPixels), repeated(3 * kPixels);
  for (std::size_t i = 0; i < kPixels; ++i)
    grey[i] = repeated[3 * i] = repeated[3 * i + 1] = repeated[3 * i + 2] = floats[i];
  CHECK(depth_of(model, {grey.data(), kWidth, kHeight, 1, SLIDE_FLOAT32, 0}) ==
        depth_of(model, {repeated.data(), kWidth, kHeight, 3, SLIDE_FLOAT32, 0}));

  // Written with gaps, which stay as they were, as bytes rounded to nearest.
  constexpr std::size_t kOut = kWidth + 3;
  std::vector<unsigned char> out(kOut * kHeight, 77);
  const slide_buffer buffer = {out.data(), kWidth, kHeight, 1, SLIDE_UINT8, kOut};
  const slide_image image = {bytes.data(), kWidth, kHeight, 3, SLIDE_UINT8, 0};
  REQUIRE(slide_disparity(model.model, &image, &buffer) == SLIDE_OK);
  for (std::size_t y = 0; y < kHeight; ++y) {
    for (std::size_t x = 0; x < kWidth; ++x)
      REQUIRE(std::abs(out[y * kOut + x] - 255 * expected[y * kWidth + x]) <= 0.5001);
    REQUIRE(out[y * kOut + kWidth] == 77);
    REQUIRE(out[y * kOut + kOut - 1] == 77);
  }

  const auto refused = [&](slide_image wrong, slide_buffer into) {
    return slide_disparity(model.model, &wrong, &into) == SLIDE_USAGE;
  };
  CHECK(refused({bytes.data(), kWidth, kHeight, 2, SLIDE_UINT8, 0}, buffer));
  CHECK(refused({bytes.data(), kWidth, kHeight, 3, 5, 0}, buffer));
  CHECK(refused({bytes.data(), kWidth, kHeight, 3, SLIDE_UINT8, 3 * kWidth - 1}, buffer));
  CHECK(refused({floats.data(), kWidth, kHeight, 3, SLIDE_FLOAT32, 12 * kWidth + 2}, buffer));
  CHECK(refused({nullptr, kWidth, kHeight, 3, SLIDE_UINT8, 0}, buffer));
  CHECK(refused(image, {nullptr, kWidth, kHeight, 1, SLIDE_UINT8, 0}));
  CHECK(refused(image, {out.data(), kWidth, kHeight - 1, 1, SLIDE_UINT8, 0}));
  CHECK(refused(image, {out.data(), kWidth, kHeight, 3, SLIDE_UINT8, 0}));
  CHECK(refused(image, {out.data(), kWidth, kHeight, 1, SLIDE_UINT8, kWidth - 1}));
}

TEST_CASE("C API: depth of 30 frames with one preparation, each as with a model of its own") {
  struct Log {
    std::vector<std::string> lines;
  } log;
  slide_settings settings = small_settings();
  settings.user = &log;
  settings.log = [](void* user, const char* line) { static_cast<Log*>(user)->lines.emplace_back(line); };
  const Model model(settings);
  REQUIRE(slide_model_prepare(model.model, kWidth, kHeight) == SLIDE_OK);
  Scene scene;
  for (int frame = 0; frame < 30; ++frame) {
    scene.rgb[static_cast<std::size_t>(frame) * 100] += 0.05F;
    const std::vector<float> map = depth_of(model, scene.colours());
    if (frame % 10 == 9) CHECK(map == depth_of(Model(), scene.colours()));
  }
  REQUIRE(log.lines.size() == 30);
  for (const std::string& line : log.lines) CHECK(line.find("prepared before") != std::string::npos);
  Scene other;
  const slide_image half = {other.rgb.data(), kWidth, kHeight / 2, 3, SLIDE_FLOAT32, 0};
  (void)depth_of(model, half);
  CHECK(log.lines.back().find("prepared before") == std::string::npos);
  CHECK(slide_model_prepare(model.model, 0, kHeight) == SLIDE_BAD_INPUT);
}

TEST_CASE("C API: the maps of a photo come out as they went in") {
  const Scene scene;
  const Model model;
  Photo photo;
  REQUIRE(make(model, scene, photo) == SLIDE_OK);
  const auto map = [&](slide_map which, int channels) {
    std::vector<float> values(static_cast<std::size_t>(channels) * kPixels, kNan);
    const slide_buffer buffer = buffer_of(values, kWidth, kHeight, channels);
    CHECK(slide_photo_has(photo.photo, which) == 1);
    REQUIRE_MESSAGE(slide_photo_map(photo.photo, which, &buffer) == SLIDE_OK, slide_last_error());
    return values;
  };
  CHECK(map(SLIDE_FRONT_COLOUR, 3) == scene.rgb);
  CHECK(map(SLIDE_DISPARITY, 1) == scene.disparity);  // already 0 to 1
  const std::vector<float> front = map(SLIDE_FRONT_DISPARITY, 1);
  const std::vector<float> behind = map(SLIDE_BACKGROUND_DISPARITY, 1);
  const std::vector<float> colours = map(SLIDE_BACKGROUND_COLOUR, 3);
  const std::vector<float> hole = map(SLIDE_HOLE, 1);
  const std::vector<float> visibility = map(SLIDE_VISIBILITY, 1);
  std::size_t holes = 0;
  for (std::size_t i = 0; i < kPixels; ++i) {
    REQUIRE(behind[i] <= front[i]);
    REQUIRE((visibility[i] >= 0 && visibility[i] <= 1));
    REQUIRE((hole[i] == 0 || hole[i] == 1));
    holes += hole[i] == 1 ? 1 : 0;
    if (hole[i] == 0) REQUIRE(colours[3 * i] == scene.rgb[3 * i]);
  }
  CHECK(holes > 0);
  CHECK(holes < kPixels);
  CHECK(slide_photo_has(photo.photo, SLIDE_MATTE) == 0);
  std::vector<float> none(kPixels);
  const slide_buffer buffer = buffer_of(none, kWidth, kHeight, 1);
  CHECK(slide_photo_map(photo.photo, SLIDE_MATTE, &buffer) == SLIDE_USAGE);
  CHECK(slide_photo_map(photo.photo, SLIDE_FRONT_COLOUR, &buffer) == SLIDE_USAGE);
  CHECK(slide_photo_map(photo.photo, 99, &buffer) == SLIDE_USAGE);
  CHECK(slide_photo_has(photo.photo, 99) == 0);
  CHECK(slide_photo_has(nullptr, SLIDE_HOLE) == 0);

  // A matte that is given is the matte that comes out.
  const slide_image image = scene.colours();
  const slide_image given = scene.map();
  Photo matted;
  const slide_scene path = short_path();
  REQUIRE(slide_make(model.model, &image, &given, &given, &path, &matted.photo) == SLIDE_OK);
  REQUIRE(slide_photo_map(matted.photo, SLIDE_MATTE, &buffer) == SLIDE_OK);
  CHECK(none == scene.disparity);
}

TEST_CASE("C API: a camera path of one's own is what the layers are made for") {
  const Scene scene;
  const Model model;
  Photo circle;
  REQUIRE(make(model, scene, circle) == SLIDE_OK);
  CHECK(slide_photo_view_count(circle.photo) == 3);
  CHECK(slide_photo_view_count(nullptr) == 0);
  // The first of three places on a circle of 4 %: P = 0.04 · 48 = f·x·(1/1 - 1/10), f = 48.
  slide_view view = {};
  REQUIRE(slide_photo_view(circle.photo, 0, &view) == SLIDE_OK);
  CHECK(view.translation[0] == doctest::Approx(-0.04 / 0.9).epsilon(1e-4));
  CHECK(view.zoom > 1);
  CHECK(slide_photo_view(circle.photo, 3, &view) == SLIDE_USAGE);

  // A camera that stands still uncovers nothing: one layer.
  const std::array<slide_view, 2> still = {slide_view_at(0, 0, 0), slide_view_at(0, 0, 0)};
  slide_scene path = short_path();
  path.views = still.data();
  path.view_count = still.size();
  Photo flat;
  REQUIRE_MESSAGE(make(model, scene, flat, path) == SLIDE_OK, slide_last_error());
  CHECK(slide_photo_view_count(flat.photo) == 2);
  CHECK(slide_photo_has(flat.photo, SLIDE_BACKGROUND_COLOUR) == 0);
  CHECK(slide_photo_has(circle.photo, SLIDE_BACKGROUND_COLOUR) == 1);

  const auto refused = [&](const slide_scene& wrong) {
    Photo none;
    return make(model, scene, none, wrong) == SLIDE_USAGE && none.photo == nullptr;
  };
  slide_scene wrong = path;
  wrong.path = "swing";
  CHECK(refused(wrong));
  wrong = path;
  wrong.view_count = 0;
  CHECK(refused(wrong));
  wrong = short_path();
  wrong.view_count = 2;
  CHECK(refused(wrong));
  wrong = short_path();
  wrong.path = "spiral";
  CHECK(refused(wrong));
  slide_view zoomed = still[0];
  zoomed.zoom = 0;
  wrong = path;
  wrong.views = &zoomed;
  wrong.view_count = 1;
  CHECK(refused(wrong));
}

TEST_CASE("C API: fill stands for no network, not for a file") {
  slide_settings settings = small_settings();
  settings.inpaint_weights = "fill";
  CHECK(Model(settings).status == SLIDE_OK);
  settings.inpaint_weights = "fill.safetensors";
  CHECK(Model(settings).status == SLIDE_BAD_WEIGHTS);
}

TEST_CASE("C API: a photo comes from a file or its bytes and becomes a page") {
  const TemporaryFolder folder;
  const Scene scene;
  slide::Image image(kWidth, kHeight, 3);
  image.data.assign(scene.rgb.begin(), scene.rgb.end());
  slide::write_png(folder.file("photo.png"), image);
  const Model model;
  const slide_scene path = short_path();
  Photo photo;
  REQUIRE_MESSAGE(slide_open(model.model, folder.file("photo.png").c_str(), &path, &photo.photo) == SLIDE_OK,
                  slide_last_error());
  const auto save = [&](const char* name, const slide_output* output = nullptr) {
    return slide_export(photo.photo, folder.file(name).c_str(), output);
  };
  REQUIRE(save("photo.html") == SLIDE_OK);
  CHECK(bytes_of_file(folder.file("photo.html")).size() > 5000);
  CHECK(save("photo.doc") == SLIDE_USAGE);
  CHECK(message_has("photo.doc"));
  // Neither its own file nor another program's is replaced.
  CHECK(save("photo.png") == SLIDE_USAGE);
  write_bytes(folder.file("other.gif"), std::as_bytes(std::span("of somebody else", 16)));
  CHECK(save("other.gif") == SLIDE_USAGE);
  CHECK(message_has("other.gif"));
  slide_output overwriting;
  slide_output_init(&overwriting, sizeof overwriting);
  overwriting.overwrite = 1;
  CHECK(save("photo.png", &overwriting) == SLIDE_USAGE);
  CHECK(save("other.gif", &overwriting) == SLIDE_OK);
  CHECK(folder.entries() == 3);

  const std::vector<std::byte> bytes = bytes_of_file(folder.file("photo.png"));
  Photo decoded;
  REQUIRE(slide_decode(model.model, bytes.data(), bytes.size(), &path, &decoded.photo) == SLIDE_OK);
  REQUIRE(slide_export(decoded.photo, folder.file("decoded.html").c_str(), nullptr) == SLIDE_OK);
  CHECK(bytes_of_file(folder.file("decoded.html")) == bytes_of_file(folder.file("photo.html")));
  Photo none;
  CHECK(slide_decode(model.model, bytes.data(), bytes.size() / 2, &path, &none.photo) == SLIDE_BAD_INPUT);
}

TEST_CASE("C API: what goes to a function is what goes to a file, with nothing left behind") {
  const TemporaryFolder folder;
  const Scene scene;
  const Model model;
  Photo photo;
  REQUIRE(make(model, scene, photo) == SLIDE_OK);
  slide_output output;
  slide_output_init(&output, sizeof output);
  output.width = 24;
  output.height = 16;
  output.title = "A disc & a wall";
  std::vector<std::byte> bytes;
  const slide_write append = [](void* user, const void* data, size_t size) {
    const auto* first = static_cast<const std::byte*>(data);
    static_cast<std::vector<std::byte>*>(user)->insert(static_cast<std::vector<std::byte>*>(user)->end(),
                                                       first, first + size);
    return 1;
  };
  for (const std::string format : {"html", ".glb", "ply", "gif", "png", "y4m"}) {
    CAPTURE(format);
    bytes.clear();
    REQUIRE_MESSAGE(slide_encode(photo.photo, format.c_str(), &output, append, &bytes) == SLIDE_OK,
                    slide_last_error());
    const std::string file = folder.file("x." + (format[0] == '.' ? format.substr(1) : format));
    REQUIRE(slide_export(photo.photo, file.c_str(), &output) == SLIDE_OK);
    CHECK(bytes == bytes_of_file(file));
  }
  for (const char* wrong : {"", ".", "doc", "a/b.gif"}) {
    const std::string format = wrong;
    CAPTURE(format);
    CHECK(slide_encode(photo.photo, wrong, &output, append, &bytes) == SLIDE_USAGE);
  }
  const slide_write full = [](void*, const void*, size_t) { return 0; };
  CHECK(slide_encode(photo.photo, "html", &output, full, nullptr) == SLIDE_OUTPUT);
  CHECK(slide_encode(photo.photo, "html", &output, nullptr, nullptr) == SLIDE_USAGE);
  output.progress = [](void*, const char* stage, double) { return std::string(stage) == "writing" ? 0 : 1; };
  CHECK(slide_encode(photo.photo, "gif", &output, append, &bytes) == SLIDE_CANCELLED);
  output.height = 0;
  CHECK(slide_encode(photo.photo, "gif", &output, append, &bytes) == SLIDE_USAGE);
}

TEST_CASE("C API: structures may be those of an older or a newer header") {
  // Older: it ends before `threads`; what follows in memory is another's.
  alignas(slide_settings) std::array<std::byte, sizeof(slide_settings) + 64> memory{};
  memory.fill(std::byte{0xAB});
  auto* const settings = reinterpret_cast<slide_settings*>(memory.data());
  constexpr std::size_t kOlder = offsetof(slide_settings, threads);
  slide_settings_init(settings, kOlder);
  CHECK(memory[kOlder] == std::byte{0xAB});
  CHECK(settings->max_side == 1536);
  settings->depth_weights = settings->inpaint_weights = "formula";
  CHECK_MESSAGE(Model(*settings).status == SLIDE_OK, slide_last_error());
  // Newer: it has more fields, which are zero until they are set.
  slide_settings_init(settings, memory.size());
  CHECK(settings->struct_size == memory.size());
  CHECK(std::all_of(memory.begin() + sizeof(slide_settings), memory.end(),
                    [](std::byte b) { return b == std::byte{0}; }));
  slide_model* model = nullptr;
  settings->depth_weights = settings->inpaint_weights = "formula";
  CHECK_MESSAGE(slide_model_create(settings, &model) == SLIDE_OK, slide_last_error());
  slide_model_free(model);
  model = nullptr;
  memory.back() = std::byte{1};
  CHECK(slide_model_create(settings, &model) == SLIDE_USAGE);
  CHECK(message_has("newer library"));
  CHECK(model == nullptr);
}

TEST_CASE("C API: wrong arguments are refused with a message") {
  const Scene scene;
  const Model model;
  const slide_image image = scene.colours();
  Photo photo;
  CHECK(slide_make(model.model, nullptr, nullptr, nullptr, nullptr, &photo.photo) == SLIDE_USAGE);
  CHECK(message_has("NULL"));
  CHECK(slide_make(nullptr, &image, nullptr, nullptr, nullptr, &photo.photo) == SLIDE_USAGE);
  CHECK(slide_make(model.model, &image, nullptr, nullptr, nullptr, nullptr) == SLIDE_USAGE);
  CHECK(slide_make(model.model, &image, &image, nullptr, nullptr, &photo.photo) == SLIDE_USAGE);
  CHECK(message_has("1 channel"));
  CHECK(slide_open(model.model, nullptr, nullptr, &photo.photo) == SLIDE_USAGE);
  CHECK(slide_photo_size(nullptr, nullptr, nullptr) == SLIDE_USAGE);
  CHECK(slide_render(nullptr, nullptr, nullptr) == SLIDE_USAGE);
  CHECK(slide_export(nullptr, "x.html", nullptr) == SLIDE_USAGE);
  CHECK(slide_disparity(nullptr, &image, nullptr) == SLIDE_USAGE);
  slide_photo_free(nullptr);
  slide_model_free(nullptr);
  slide_settings_init(nullptr, sizeof(slide_settings));
  slide_scene path = short_path();
  path.struct_size = 0;
  CHECK(make(model, scene, photo, path) == SLIDE_USAGE);
  CHECK(message_has("slide_scene_init"));
  path = short_path();
  path.frames = 0;
  CHECK(make(model, scene, photo, path) == SLIDE_USAGE);
  CHECK(!message_has("internal"));
  path = short_path();
  path.parallax_percent = std::numeric_limits<double>::quiet_NaN();
  CHECK(make(model, scene, photo, path) == SLIDE_USAGE);
  path = short_path();
  path.near_depth = 20;
  CHECK(make(model, scene, photo, path) == SLIDE_USAGE);
  path = short_path();
  path.fov_degrees = -1;
  CHECK(make(model, scene, photo, path) == SLIDE_USAGE);
  CHECK(photo.photo == nullptr);
  slide_settings settings = small_settings();
  settings.max_side = 0;
  CHECK(Model(settings).status == SLIDE_USAGE);
  settings = small_settings();
  settings.threads = -1;
  CHECK(Model(settings).status == SLIDE_USAGE);
  settings = small_settings();
  settings.precision = "fp7";
  CHECK(Model(settings).status == SLIDE_USAGE);
  settings = small_settings();
  settings.depth_side = 7;
  CHECK(Model(settings).status == SLIDE_USAGE);
  CHECK(slide_model_create(&settings, nullptr) == SLIDE_USAGE);
}

TEST_CASE("C API: bad images, bad files, bad weights and too little memory have their own status") {
  const TemporaryFolder folder;
  Scene scene;
  const Model model;
  Photo photo;
  const slide_image negative = {scene.rgb.data(), -1, kHeight, 3, SLIDE_FLOAT32, 0};
  CHECK(slide_make(model.model, &negative, nullptr, nullptr, nullptr, &photo.photo) == SLIDE_BAD_INPUT);
  write_bytes(folder.file("x.jpg"), std::as_bytes(std::span("no photo", 8)));
  CHECK(slide_open(model.model, folder.file("x.jpg").c_str(), nullptr, &photo.photo) == SLIDE_BAD_INPUT);
  CHECK(message_has("x.jpg"));
  CHECK(slide_open(model.model, folder.file("none.jpg").c_str(), nullptr, &photo.photo) == SLIDE_BAD_INPUT);
  const std::string weights = folder.file("x.jpg");
  slide_settings settings = small_settings();
  settings.inpaint_weights = weights.c_str();
  CHECK(Model(settings).status == SLIDE_BAD_WEIGHTS);
  settings = small_settings();
  settings.memory_limit = 1;
  CHECK(make(Model(settings), scene, photo) == SLIDE_OUT_OF_MEMORY);
  scene.disparity[3] = kNan;
  CHECK(make(model, scene, photo) == SLIDE_BAD_INPUT);
  CHECK(message_has("(3, 0)"));
  scene.disparity[3] = 0;
  scene.rgb[3 * 5] = std::numeric_limits<float>::infinity();
  CHECK(make(model, scene, photo) == SLIDE_BAD_INPUT);
  CHECK(photo.photo == nullptr);
}

TEST_CASE("C API: the progress callback is given its pointer, and can stop the work") {
  const Scene scene;
  slide_settings settings = small_settings();
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
  const Model model(settings);
  {
    Photo photo;
    REQUIRE(make(model, scene, photo) == SLIDE_OK);
    CHECK(calls.made > 2);
  }
  calls = {1, 0};
  Photo photo;
  CHECK(make(model, scene, photo) == SLIDE_CANCELLED);
  CHECK(calls.made == 2);
  CHECK(photo.photo == nullptr);
  CHECK(!std::string(slide_last_error()).empty());
  calls = {1000000, 0};  // and the model is as good as before
  CHECK(make(model, scene, photo) == SLIDE_OK);
}

TEST_CASE(
    "C API: two models in two threads, of one and of three threads, say the same, each with its errors") {
  const Scene scene;
  const std::vector<float> expected = depth_of(Model(), scene.colours());
  std::array<bool, 2> good{};
  const auto work = [&](std::size_t i) {
    slide_settings settings = small_settings();
    settings.threads = i == 0 ? 1 : 3;
    const Model model(settings);
    std::vector<float> map(kPixels, kNan);
    const slide_buffer buffer = buffer_of(map, kWidth, kHeight, 1);
    const slide_image image = scene.colours();
    good[i] = true;
    for (int round = 0; round < 5; ++round) {
      good[i] = good[i] && slide_disparity(model.model, &image, &buffer) == SLIDE_OK && map == expected;
      good[i] =
          good[i] && slide_disparity(model.model, nullptr, &buffer) == SLIDE_USAGE && message_has("NULL");
    }
  };
  std::thread other([&] { work(1); });
  work(0);
  other.join();
  CHECK(good[0]);
  CHECK(good[1]);
  (void)depth_of(Model(), scene.colours());
  CHECK(std::string(slide_last_error()).empty());
}

TEST_CASE("C API: the examples do what they say") {
  const TemporaryFolder folder;
  const Scene scene;
  slide::Image image(kWidth, kHeight, 3);
  image.data.assign(scene.rgb.begin(), scene.rgb.end());
  slide::write_png(folder.file("photo.png"), image);
  const auto example = slide::test::run_program(
      SLIDE_C_EXAMPLE, {folder.file("photo.png"), folder.file("page.html"), folder.file("view.ppm")});
  REQUIRE_MESSAGE(example.code == 0, example.errors);
  CHECK(bytes_of_file(folder.file("page.html")).size() > 5000);
  CHECK(bytes_of_file(folder.file("view.ppm")).size() ==
        std::string("P6\n48 32\n255\n").size() + 3 * kPixels);
  CHECK(slide::test::run_program(SLIDE_C_EXAMPLE, {"none.png", "a.html", "b.ppm"}).code == SLIDE_BAD_INPUT);
  const auto stream = slide::test::run_program(SLIDE_C_CAMERA_STREAM, {"3", "64", "48"});
  REQUIRE_MESSAGE(stream.code == 0, stream.errors);
  CHECK(std::count(stream.output.begin(), stream.output.end(), '\n') == 3);
  std::size_t prepared = 0;
  for (std::size_t at = stream.output.find("prepared before"); at != std::string::npos;
       at = stream.output.find("prepared before", at + 1))
    ++prepared;
  CHECK(prepared == 3);
}
