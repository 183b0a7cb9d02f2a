#include "render/html.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>

#include "render/base64.h"
#include "render/codec.h"
#include "render/image_file.h"
#include "runtime/error.h"
#include "tests/render/decoders.h"
#include "tests/render/sample_scene.h"
#include "tests/temporary_folder.h"

namespace {

using Json = nlohmann::json;

std::vector<std::uint8_t> as_bytes(std::string_view text) { return {text.begin(), text.end()}; }

/// What stands between two marks, the first time they occur.
std::string between(const std::string& text, const std::string& from, const std::string& to) {
  const std::size_t a = text.find(from);
  REQUIRE(a != std::string::npos);
  const std::size_t b = text.find(to, a + from.size());
  REQUIRE(b != std::string::npos);
  return text.substr(a + from.size(), b - a - from.size());
}

Json scene_of(const std::string& page) {
  return Json::parse(between(page, "<script id=\"scene\" type=\"application/json\">", "</script>"));
}

std::vector<std::uint8_t> payload(const std::string& uri) {
  const std::string text = uri.substr(uri.find(',') + 1);
  std::vector<std::uint8_t> out;
  unsigned group = 0;
  int bits = 0;
  const std::string_view alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  for (const char c : text) {
    if (c == '=') break;
    group = group << 6U | static_cast<unsigned>(alphabet.find(c));
    bits += 6;
    if (bits < 8) continue;
    bits -= 8;
    out.push_back(static_cast<std::uint8_t>(group >> static_cast<unsigned>(bits) & 255U));
  }
  return out;
}

}  // namespace

TEST_CASE("Base64 gives RFC 4648's test vectors") {
  const std::vector<std::pair<std::string, std::string>> vectors = {{"", ""},
                                                                    {"f", "Zg=="},
                                                                    {"fo", "Zm8="},
                                                                    {"foo", "Zm9v"},
                                                                    {"foob", "Zm9vYg=="},
                                                                    {"fooba", "Zm9vYmE="},
                                                                    {"foobar", "Zm9vYmFy"}};
  for (const auto& [text, expected] : vectors) CHECK(slide::base64(as_bytes(text)) == expected);
}

TEST_CASE("The viewer's page holds the layers, with disparity in 16 bits at the mesh's vertices") {
  const slide::Layers scene = sample_scene(60, 40);
  slide::HtmlOptions options;
  options.mesh_side = 30;
  const std::string page = slide::encode_html(scene, slide::make_camera(60, 40), options);
  const Json json = scene_of(page);
  CHECK(json["width"] == 60);
  CHECK(json["height"] == 40);
  CHECK(json["parallax"].get<double>() == doctest::Approx(2.4));
  const Json& layer = json["foreground"];
  CHECK(layer["columns"] == 30);
  CHECK(layer["rows"] == 20);
  const DecodedPng disparity = independent_png(payload(layer["disparity"]));
  REQUIRE(disparity.width == 30);
  REQUIRE(disparity.height == 20);
  REQUIRE(disparity.channels == 3);
  const DecodedPng alpha = independent_png(payload(layer["alpha"]));
  CHECK(alpha.width == 60);
  CHECK(alpha.channels == 1);
  CHECK(slide::decode_photo(payload(between(page, "src=\"", "\"")), "colour").colour.width == 60);
  const auto value_at = [&](int column, int row) {
    const auto i = static_cast<std::size_t>((row * 30 + column) * 3);
    return disparity.samples[i] * 256 + disparity.samples[i + 1];
  };
  CHECK(value_at(0, 0) == 0);
  CHECK(value_at(15, 10) == 65535);  // inside the square
  // Column c lies at x = 59 c / 29. The square is centred at x = 30; beyond 7 pixels from there the disparity
  // falls from 1 by a half a pixel. Column 19 is 8.6552 pixels from the centre.
  CHECK(std::abs(value_at(19, 10) - 65535 * (1 - (59 * 19 / 29.0 - 37) / 2)) <= 1);
  CHECK(page.find("http://") == std::string::npos);
  CHECK(page.find("https://") == std::string::npos);
  CHECK(page.find("{{") == std::string::npos);
}

TEST_CASE("A title is text, whatever it holds") {
  slide::HtmlOptions options;
  options.title = "</title><script>alert(1)</script> \"{{scene}}\" & more";
  const std::string page = slide::encode_html(sample_scene(24, 16), slide::make_camera(24, 16), options);
  CHECK(between(page, "<title>", "</title>") ==
        "&lt;/title&gt;&lt;script&gt;alert(1)&lt;/script&gt; &quot;{{scene}}&quot; &amp; more");
  CHECK(page.find("alert(1)</script>") == std::string::npos);
  CHECK(scene_of(page)["width"] == 24);
}

TEST_CASE("The photo stands in the page once, as a picture with its description") {
  slide::HtmlOptions options;
  options.title = "Cat";
  options.alt = "A \"cat\" <asleep> & a dog";
  const slide::Layers scene = sample_scene(24, 16);
  const std::string page = slide::encode_html(scene, slide::make_camera(24, 16), options);
  const std::string alt = "A &quot;cat&quot; &lt;asleep&gt; &amp; a dog";
  CHECK(between(page, "<img id=\"still\" alt=\"", "\"") == alt);
  CHECK(between(page, "aria-label=\"", "\"") == alt);
  CHECK(between(page, "<title>", "</title>") == "Cat");
  const std::string still =
      "data:image/jpeg;base64," + slide::base64(slide::encode_jpeg(scene.foreground.colour, 92));
  const std::size_t first = page.find(still);
  CHECK(first < page.find("<script"));
  CHECK(page.find(still, first + 1) == std::string::npos);
  options.alt = "";
  CHECK(between(slide::encode_html(scene, slide::make_camera(24, 16), options), "<img id=\"still\" alt=\"",
                "\"") == "Cat");
}

TEST_CASE("A single layer has neither background nor visibility in its page") {
  slide::Layers layers;
  layers.foreground = sample_scene(24, 16).foreground;
  const TemporaryFolder folder;
  slide::write_html(folder.file("a.html"), layers, slide::make_camera(24, 16));
  const std::vector<std::uint8_t> bytes = slide::read_file(folder.file("a.html"));
  const Json json = scene_of(std::string(bytes.begin(), bytes.end()));
  CHECK_FALSE(json.contains("background"));
  CHECK_FALSE(json["foreground"].contains("alpha"));
}

TEST_CASE("Viewer options out of range are refused") {
  const slide::Layers scene = sample_scene(24, 16);
  const slide::Camera camera = slide::make_camera(24, 16);
  const auto refused = [&](const slide::HtmlOptions& options) {
    CHECK_THROWS_AS(static_cast<void>(slide::encode_html(scene, camera, options)), slide::Error);
  };
  slide::HtmlOptions options;
  options.parallax_percent = std::nan("");
  refused(options);
  options = {};
  options.focus = 1.5;
  refused(options);
  options = {};
  options.mesh_side = 1;
  refused(options);
  options = {};
  options.jpeg_quality = 0;
  refused(options);
}
