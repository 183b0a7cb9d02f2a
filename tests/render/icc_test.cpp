#include "render/icc.h"

#include <doctest/doctest.h>
#include <png.h>

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "render/codec.h"
#include "render/image_file.h"

namespace {

using slide::ColourProfile;
using slide::Image;
using Bytes = std::vector<std::uint8_t>;

void put_u32(Bytes& out, std::uint32_t v) {
  for (const unsigned shift : {24U, 16U, 8U, 0U})
    out.push_back(static_cast<std::uint8_t>(v >> shift & 0xFFU));
}

void put_text(Bytes& out, const std::string& text) { out.insert(out.end(), text.begin(), text.end()); }

void put_fixed(Bytes& out, double v) {
  put_u32(out, static_cast<std::uint32_t>(static_cast<std::int32_t>(std::lround(v * 65536))));
}

struct Tag {
  std::string signature;
  Bytes data;
};

Bytes xyz(double x, double y, double z) {
  Bytes out;
  put_text(out, "XYZ ");
  put_u32(out, 0);
  for (const double v : {x, y, z}) put_fixed(out, v);
  return out;
}

Bytes parametric(int type, const std::vector<double>& parameters) {
  Bytes out;
  put_text(out, "para");
  put_u32(out, 0);
  put_u32(out, static_cast<std::uint32_t>(type) << 16U);
  for (const double v : parameters) put_fixed(out, v);
  return out;
}

Bytes table(const std::vector<unsigned>& values) {
  Bytes out;
  put_text(out, "curv");
  put_u32(out, 0);
  put_u32(out, static_cast<std::uint32_t>(values.size()));
  for (const unsigned v : values) {
    out.push_back(static_cast<std::uint8_t>(v >> 8U));
    out.push_back(static_cast<std::uint8_t>(v & 0xFFU));
  }
  return out;
}

Bytes profile_of(const std::string& space, const std::vector<Tag>& tags) {
  // As much of the header as libpng asks for: size, version, class, spaces, signature, D50.
  Bytes out;
  std::size_t size = 132;
  for (const Tag& tag : tags) size += 12 + tag.data.size();
  put_u32(out, static_cast<std::uint32_t>(size));
  put_u32(out, 0);
  put_u32(out, 0x04300000);
  put_text(out, "mntr" + space + "XYZ ");
  out.resize(36, 0);
  put_text(out, "acsp");
  out.resize(68, 0);
  for (const std::uint32_t v : {0xF6D6U, 0x10000U, 0xD32DU}) put_u32(out, v);
  out.resize(128, 0);
  put_u32(out, static_cast<std::uint32_t>(tags.size()));
  std::size_t offset = 132 + 12 * tags.size();
  for (const Tag& tag : tags) {
    put_text(out, tag.signature);
    put_u32(out, static_cast<std::uint32_t>(offset));
    put_u32(out, static_cast<std::uint32_t>(tag.data.size()));
    offset += tag.data.size();
  }
  for (const Tag& tag : tags) out.insert(out.end(), tag.data.begin(), tag.data.end());
  return out;
}

const std::vector<double> kSrgbCurve = {2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045};

Bytes rgb_profile(const Bytes& red, const Bytes& green, const Bytes& blue, const Bytes& curve) {
  return profile_of(
      "RGB ",
      {{"rXYZ", red}, {"gXYZ", green}, {"bXYZ", blue}, {"rTRC", curve}, {"gTRC", curve}, {"bTRC", curve}});
}

/// The primaries of Display P3 under D50 as its profiles have them.
Bytes display_p3() {
  return rgb_profile(xyz(0.515121, 0.241196, -0.001053), xyz(0.291977, 0.692245, 0.041885),
                     xyz(0.157104, 0.066574, 0.784073), parametric(3, kSrgbCurve));
}

Bytes srgb() {
  return rgb_profile(xyz(0.436066, 0.222488, 0.013916), xyz(0.385147, 0.716873, 0.097076),
                     xyz(0.143066, 0.060608, 0.714096), parametric(3, kSrgbCurve));
}

Image pixel(double r, double g, double b) {
  Image image(1, 1, 3);
  image.data = {static_cast<float>(r / 255), static_cast<float>(g / 255), static_cast<float>(b / 255)};
  return image;
}

}  // namespace

TEST_CASE("Display P3 becomes sRGB as Little CMS has it") {
  const std::optional<ColourProfile> profile = slide::read_icc_profile(display_p3());
  REQUIRE(profile);
  // lcms2 2.14, relative colorimetric, 8 bits.
  constexpr std::array<std::array<int, 6>, 9> kColours = {{{255, 0, 0, 255, 0, 0},
                                                           {0, 255, 0, 0, 255, 0},
                                                           {0, 0, 255, 0, 0, 255},
                                                           {255, 255, 255, 255, 255, 255},
                                                           {128, 64, 32, 138, 59, 21},
                                                           {12, 200, 150, 0, 204, 146},
                                                           {250, 240, 10, 252, 240, 0},
                                                           {90, 90, 90, 90, 90, 90},
                                                           {200, 20, 120, 219, 0, 122}}};
  for (const auto& c : kColours) {
    Image image = pixel(c[0], c[1], c[2]);
    slide::apply_profile(*profile, image);
    for (std::size_t i = 0; i < 3; ++i)
      CHECK(std::abs(255 * image.data[i] - static_cast<float>(c[3 + i])) <= 0.75F);
  }
}

TEST_CASE("sRGB's own profile, tables, damaged profiles and print leave values as they are") {
  CHECK(!slide::read_icc_profile(srgb()));
  CHECK(!slide::gamma_profile(0.45455));
  const Bytes p3 = display_p3();
  for (std::size_t length = 0; length < p3.size(); ++length)
    CHECK(!slide::read_icc_profile(std::span(p3).first(length)));
  Bytes print = p3;
  print[16] = 'C';
  CHECK(!slide::read_icc_profile(print));
  CHECK(!slide::read_icc_profile(profile_of("RGB ", {{"A2B0", Bytes(100, 1)}})));
}

TEST_CASE("curves are exponents, tables and the five parametric kinds") {
  const auto linear = [](const Bytes& curve, double value) {
    const std::optional<ColourProfile> profile =
        slide::read_icc_profile(profile_of("GRAY", {{"kTRC", curve}}));
    REQUIRE(profile);
    Image image(1, 1, 1, static_cast<float>(value));
    slide::apply_profile(*profile, image);
    const auto v = static_cast<double>(image.data[0]);
    return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
  };
  const auto near = [](double v) { return doctest::Approx(v).epsilon(1e-3); };
  CHECK(linear(table({}), 0.3) == near(0.3));                               // no entry: linear
  CHECK(linear(table({0x01CD}), 0.3) == near(std::pow(0.3, 461 / 256.0)));  // one entry: an exponent
  CHECK(linear(table({0, 10000, 65535}), 0.25) == near(5000 / 65535.0));
  CHECK(linear(parametric(0, {1.8}), 0.3) == near(std::pow(0.3, 1.8)));
  CHECK(linear(parametric(1, {2, 0.9, 0.1}), 0.3) == near(std::pow(0.37, 2)));
  CHECK(linear(parametric(2, {2, 0.8, 0.1, 0.05}), 0.3) == near(std::pow(0.34, 2) + 0.05));
  CHECK(linear(parametric(3, {2, 0.9, 0.1, 0.5, 0.4}), 0.3) == near(0.15));
  CHECK(linear(parametric(4, {2, 0.9, 0.1, 0.5, 0.4, 0.02, 0.03}), 0.3) == near(0.18));
  CHECK(linear(parametric(4, {2, 0.9, 0.1, 0.5, 0.4, 0.02, 0.03}), 0.6) == near(std::pow(0.64, 2) + 0.02));
}

TEST_CASE("a profile in a PNG and a gamma are applied to photos, not to maps") {
  const auto png = [](const Bytes* icc, double gamma) {
    Bytes out;
    png_structp write = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
    png_infop info = png_create_info_struct(write);
    png_set_write_fn(
        write, &out,
        [](png_structp p, png_bytep bytes, std::size_t n) {
          auto* to = static_cast<Bytes*>(png_get_io_ptr(p));
          to->insert(to->end(), bytes, bytes + n);
        },
        nullptr);
    png_set_IHDR(write, info, 1, 1, 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    if (icc != nullptr)
      png_set_iCCP(write, info, "p", PNG_COMPRESSION_TYPE_BASE, icc->data(),
                   static_cast<png_uint_32>(icc->size()));
    if (gamma > 0) png_set_gAMA(write, info, gamma);
    png_write_info(write, info);
    std::array<png_byte, 3> row = {128, 128, 128};
    png_write_row(write, row.data());
    png_write_end(write, info);
    png_destroy_write_struct(&write, &info);
    return out;
  };
  const auto red = [](const Bytes& file) { return slide::decode_photo(file, "p").colour.data[0]; };
  CHECK(red(png(nullptr, 0)) == doctest::Approx(128 / 255.0));
  CHECK(red(png(nullptr, 1)) == doctest::Approx(slide::srgb_from_linear(128 / 255.0F)).epsilon(1e-4));
  CHECK(slide::decode_map(png(nullptr, 1), "m").data[0] == doctest::Approx(128 / 255.0));
  const Bytes linear = rgb_profile(xyz(0.436066, 0.222488, 0.013916), xyz(0.385147, 0.716873, 0.097076),
                                   xyz(0.143066, 0.060608, 0.714096), parametric(0, {1}));
  CHECK(red(png(&linear, 0)) == doctest::Approx(slide::srgb_from_linear(128 / 255.0F)).epsilon(1e-3));
}

TEST_CASE("the colours of an image with alpha change, alpha does not; grey takes one curve") {
  const std::optional<ColourProfile> profile = slide::gamma_profile(1);
  REQUIRE(profile);
  Image rgba(1, 1, 4, 0.25F);
  slide::apply_profile(*profile, rgba);
  for (std::size_t c = 0; c < 3; ++c) CHECK(rgba.data[c] == doctest::Approx(0.5371).epsilon(1e-3));
  CHECK(rgba.data[3] == 0.25F);
  Image grey(1, 1, 2, 0.25F);
  slide::apply_profile(*profile, grey);
  CHECK(grey.data[0] == doctest::Approx(0.5371).epsilon(1e-3));
  CHECK(grey.data[1] == 0.25F);
}
