#include "render/embedded_depth.h"

#include <doctest/doctest.h>

#include "render/image_file.h"
#include "render/xmp.h"
#include "runtime/error.h"
#include "tests/render/phone_photo.h"

namespace {

using phone::Bytes;
using slide::EmbeddedMap;
using slide::Image;
using slide::Photo;

constexpr const char* kLinear = R"(GDepth:Format="RangeLinear" GDepth:Near="2" GDepth:Far="10")";
constexpr const char* kInverse = R"(GDepth:Format="RangeInverse" GDepth:Near="0.3" GDepth:Far="8.5")";
constexpr const char* kDynamic =
    R"(DepthMap:Format="RangeLinear" DepthMap:Near="2" DepthMap:Far="10" DepthMap:Units="Meters")";

Bytes plain_photo() {
  Image colour(24, 16, 3, 0.5F);
  for (std::size_t i = 0; i < colour.data.size(); ++i)
    colour.data[i] = static_cast<float>(i * 37 % 256) / 255.0F;
  return slide::encode_jpeg(colour, 90);
}

/// v = 0.2 (x + 3 y), exactly so in 16 bits: 65535 is a multiple of 5.
Image values(int width = 3, int height = 2) {
  Image map(width, height, 1);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) map.at(x, y) = 0.2F * static_cast<float>((x + 3 * y) % 6);
  return map;
}

Bytes map_file() { return slide::encode_png(values(), 16); }

Photo read(const Bytes& file, const slide::SizeCheck& check = {}) {
  return slide::decode_photo(file, "p.jpg", check, EmbeddedMap::kRead);
}

std::string message_of(const Bytes& file) {
  try {
    (void)read(file);
  } catch (const slide::Error& e) {
    CHECK(e.kind() == slide::ErrorKind::kBadInput);
    return e.what();
  }
  return "no error";
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// 1/z of z = 2 + 8 v.
void check_linear(const Image& disparity) {
  REQUIRE((disparity.width == 3 && disparity.height == 2 && disparity.channels == 1));
  for (int i = 0; i < 6; ++i)
    CHECK(disparity.data[static_cast<std::size_t>(i)] ==
          doctest::Approx(1 / (2 + 8 * 0.2 * i)).epsilon(1e-6));
}

}  // namespace

TEST_CASE("Base64 texts become bytes again; white space is skipped, other characters are refused") {
  const auto decoded = [](const char* text) {
    const auto bytes = slide::bytes_of_base64(text);
    REQUIRE(bytes.has_value());
    return std::string(bytes->begin(), bytes->end());
  };
  CHECK(decoded("").empty());
  CHECK(decoded("Zg==") == "f");
  CHECK(decoded("Zm8=") == "fo");
  CHECK(decoded("Zm9v\n YmE=") == "fooba");
  CHECK(!slide::bytes_of_base64("Zm9*").has_value());
}

TEST_CASE("GDepth in one packet: RangeLinear is distance, RangeInverse is disparity turned round") {
  check_linear(read(phone::gdepth(plain_photo(), map_file(), kLinear)).disparity);
  const Image inverse = read(phone::gdepth(plain_photo(), map_file(), kInverse)).disparity;
  for (std::size_t i = 0; i < 6; ++i)
    CHECK(inverse.data[i] == doctest::Approx(1 - 0.2 * static_cast<double>(i)).epsilon(1e-6));
  // The format's default, and numbers that some programs write instead of distances.
  CHECK(read(phone::gdepth(plain_photo(), map_file(), "GDepth:Near='0' GDepth:Far='255'")).disparity.data ==
        inverse.data);
  const Image turned =
      read(phone::gdepth(plain_photo(), map_file(), "GDepth:Near='9' GDepth:Far='1'")).disparity;
  CHECK(turned.data == values().data);
}

TEST_CASE("GDepth in an extended packet whose parts come in any order") {
  const std::string whole =
      phone::packet("<rdf:Description GDepth:Data='" + slide::base64(map_file()) + "'/>");
  const std::string main =
      std::string("<rdf:Description ") + kLinear + " xmpNote:HasExtendedXMP=\"" + phone::kGuid + "\"/>";
  const auto file = [&](std::initializer_list<std::size_t> offsets) {
    Bytes jpeg = plain_photo();
    for (const std::size_t offset : offsets)
      jpeg = phone::with_segment(jpeg, phone::extension_part(whole, offset, 50));
    return phone::with_xmp(jpeg, main);
  };
  REQUIRE(whole.size() > 150);
  REQUIRE(whole.size() <= 250);
  check_linear(read(file({100, 0, 200, 50, 150})).disparity);
  // Without one part the text ends early: the map is damaged, whatever else happens to be there.
  CHECK(contains(message_of(file({0, 50, 100})), "p.jpg"));
  CHECK(read(file({50, 100, 150, 200})).disparity.empty());
}

TEST_CASE("Dynamic Depth lies behind the photo, after what else is there") {
  const Bytes gain_map = slide::encode_jpeg(Image(8, 8, 1, 0.25F), 90);
  const Photo photo = read(phone::dynamic_depth(plain_photo(), gain_map, map_file(), kDynamic));
  check_linear(photo.disparity);
  CHECK(photo.colour.data == slide::decode_photo(plain_photo(), "p").colour.data);
  // Something that the directory does not tell of, between the photo and its items.
  Bytes junk = plain_photo();
  phone::append(junk, Bytes(13, 0x55));
  check_linear(read(phone::dynamic_depth(junk, gain_map, map_file(), kDynamic)).disparity);
  // The map as elements, found by its meaning.
  Bytes file = phone::with_xmp(
      plain_photo(),
      "<Container:Directory><rdf:Seq><rdf:li><Item:Semantic>Primary</Item:Semantic>"
      "<Item:Padding>5</Item:Padding></rdf:li><rdf:li><Item:Length> " +
          std::to_string(map_file().size()) +
          " </Item:Length><Item:Semantic>Depth</Item:Semantic></rdf:li></rdf:Seq></Container:Directory>"
          "<DepthMap:Format>RangeLinear</DepthMap:Format><DepthMap:Near>2</DepthMap:Near>"
          "<DepthMap:Far>10</DepthMap:Far><DepthMap:DepthURI>depth</DepthMap:DepthURI>");
  phone::append(file, Bytes(5, 0));
  phone::append(file, map_file());
  phone::append(file, Bytes(9, 7));  // and something behind it
  check_linear(read(file).disparity);
}

TEST_CASE("The end of the first picture is found behind scans, restart markers and thumbnails") {
  Bytes file = phone::with_segment(plain_photo(), plain_photo());  // a picture inside a segment
  const std::size_t size = file.size();
  phone::append(file, plain_photo());
  CHECK(slide::jpeg_picture_bytes(file) == size);
  const Bytes progressive = slide::read_file(std::string(SLIDE_TEST_DATA) + "/images/progressive.jpg");
  CHECK(slide::jpeg_picture_bytes(progressive) == progressive.size());
  file.resize(size - 2);
  CHECK(slide::jpeg_picture_bytes(file) == file.size());
}

TEST_CASE("The depth map is turned as the photo is") {
  Bytes jpeg = slide::read_file(std::string(SLIDE_TEST_DATA) + "/images/orientation_6.jpg");
  const Image disparity = read(phone::gdepth(jpeg, map_file(), kInverse)).disparity;
  REQUIRE((disparity.width == 2 && disparity.height == 3));
  CHECK(disparity.at(1, 0) == doctest::Approx(1));    // stored at (0, 0): a quarter turn to the right
  CHECK(disparity.at(0, 0) == doctest::Approx(0.4));  // stored at (0, 1), v = 0.6
}

TEST_CASE("A photo without a depth map has none, and one that nobody asks for is left alone") {
  const Photo none = read(plain_photo());
  CHECK(!none.has_depth);
  CHECK(none.disparity.empty());
  const Photo ignored = slide::decode_photo(phone::gdepth(plain_photo(), map_file(), kLinear), "p.jpg");
  CHECK(ignored.has_depth);
  CHECK(ignored.disparity.empty());
}

TEST_CASE("What does not fit what the file says of its depth map is refused by name") {
  CHECK(
      contains(message_of(phone::gdepth(plain_photo(), map_file(), "GDepth:Format='RangeLinear'")), "Near"));
  CHECK(contains(message_of(phone::gdepth(plain_photo(), map_file(), "GDepth:Format='Cubes'")), "Cubes"));
  CHECK(contains(message_of(phone::gdepth(plain_photo(), phone::bytes_of("GIF89a"), kLinear)), "neither"));
  Bytes cut = map_file();
  cut.resize(cut.size() / 2);
  CHECK(contains(message_of(phone::gdepth(plain_photo(), cut, kLinear)), "the depth map in p.jpg"));
  const auto directory = [&](const std::string& items) {
    return message_of(phone::with_xmp(
        plain_photo(), "<Container:Directory>" + items + "</Container:Directory><a DepthMap:DepthURI='d'/>"));
  };
  const std::string primary = "<rdf:li Item:DataURI='p'/>";
  CHECK(contains(directory(""), "no entry"));
  CHECK(contains(directory(primary + "<rdf:li Item:DataURI='d' Item:Length='99999999'/>"), "more bytes"));
  CHECK(contains(directory(primary + "<rdf:li Item:DataURI='d' Item:Length='18446744073709551615'/>"),
                 "more bytes"));
  CHECK(contains(directory(primary + "<rdf:li Item:DataURI='d' Item:Length='4'/>"), "no picture"));
}

TEST_CASE("The size of an embedded map is asked before anything of that size is allocated") {
  Bytes huge = map_file();
  const Bytes side = {0, 0, 0x4E, 0x20};  // 20000
  std::copy(side.begin(), side.end(), huge.begin() + 16);
  CHECK_THROWS_AS((void)read(phone::gdepth(plain_photo(), huge, kLinear)), slide::Error);
  std::vector<std::pair<int, int>> asked;
  (void)read(phone::gdepth(plain_photo(), map_file(), kLinear),
             [&](int width, int height) { asked.emplace_back(width, height); });
  CHECK(asked == std::vector<std::pair<int, int>>{{24, 16}, {3, 2}});
}

TEST_CASE("Every shortened or changed file is a photo or an error") {
  const Bytes whole = phone::dynamic_depth(plain_photo(), {}, map_file(), kDynamic);
  int errors = 0;
  for (std::size_t i = 4; i < whole.size(); ++i)
    for (const bool shortened : {false, true}) {
      Bytes file = whole;
      if (shortened)
        file.resize(i);
      else
        file[i] ^= 0xFFU;
      try {
        (void)read(file);
      } catch (const slide::Error&) {
        ++errors;
      }
    }
  CHECK(errors > static_cast<int>(map_file().size()));
}
