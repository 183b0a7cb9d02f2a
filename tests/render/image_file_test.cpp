#include "render/image_file.h"

#include <doctest/doctest.h>
#include <sys/stat.h>

#include <bit>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>
#include <utility>

#include "render/codec.h"
#include "render/oiio.h"
#include "render/write_image.h"
#include "runtime/error.h"
#include "tests/quick.h"
#include "tests/temporary_folder.h"

namespace {

using slide::Image;
using slide::Photo;

// The formulas of tests/oracles/make_images.py.
int sample8(int x, int y, int c) { return (x * 37 + y * 91 + c * 53 + 11) % 256; }
int sample16(int x, int y, int c) { return (x * 9173 + y * 20011 + c * 30011 + 77) % 65536; }

std::string data(const std::string& name) { return std::string(SLIDE_TEST_DATA) + "/images/" + name; }

/// The largest difference from expected(x, y, c).
double largest_error(const Image& image, const std::function<double(int, int, int)>& expected) {
  double worst = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      for (int c = 0; c < image.channels; ++c) {
        worst = std::fmax(worst, std::abs(image.at(x, y, c) - expected(x, y, c)));
      }
    }
  }
  return worst;
}

void check_size(const Image& image, int width, int height, int channels) {
  REQUIRE(image.width == width);
  REQUIRE(image.height == height);
  REQUIRE(image.channels == channels);
}

/// Red, green, blue and white quarters of 48×32 pixels.
void check_corners(const Image& image, double tolerance) {
  check_size(image, 48, 32, 3);
  const auto expected = [](int x, int y, int c) -> double {
    const bool right = x >= 24;
    const bool lower = y >= 16;
    if (right && lower) return 1;
    const int lit = right ? 1 : lower ? 2 : 0;
    return c == lit ? 1 : 0;
  };
  CHECK(largest_error(image, expected) <= tolerance);
}

std::string message_of(const std::function<void()>& action,
                       slide::ErrorKind kind = slide::ErrorKind::kBadInput) {
  try {
    action();
  } catch (const slide::Error& e) {
    CHECK(e.kind() == kind);
    return e.what();
  }
  return "no error";
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

}  // namespace

TEST_CASE("Each of the eight EXIF orientations of a JPEG shows the same picture") {
  for (int orientation = 1; orientation <= 8; ++orientation) {
    CAPTURE(orientation);
    const Photo photo = slide::read_photo(data("orientation_" + std::to_string(orientation) + ".jpg"));
    check_corners(photo.colour, 3 / 255.0);
    CHECK_FALSE(photo.horizontal_fov);
  }
}

TEST_CASE("EXIF orientation in a PNG's eXIf chunk is applied") {
  check_corners(slide::read_photo(data("orientation_8.png")).colour, 0);
}

TEST_CASE("The field of view follows from the 35 mm equivalent focal length by the diagonal, as shown") {
  const Photo photo = slide::read_photo(data("focal_35mm.jpg"));
  check_size(photo.colour, 48, 32, 3);
  const double focal_pixels = 28 * std::hypot(48, 32) / std::hypot(36, 24);
  REQUIRE(photo.horizontal_fov);
  CHECK(*photo.horizontal_fov == doctest::Approx(2 * std::atan(24 / focal_pixels)).epsilon(1e-12));
}

TEST_CASE(
    "The field of view follows from focal length and focal plane resolution of a picture made smaller "
    "since") {
  const Photo photo = slide::read_photo(data("focal_plane.jpg"));
  // 5 mm · 1200 pixels per mm at 4800 pixels of width, 48 of which are left.
  REQUIRE(photo.horizontal_fov);
  CHECK(*photo.horizontal_fov == doctest::Approx(2 * std::atan(24.0 / 60.0)).epsilon(1e-12));
}

TEST_CASE("Progressive and grey JPEG files become RGB") {
  check_corners(slide::read_photo(data("progressive.jpg")).colour,
                0.35);  // chroma is halved at the quarters' edges
  const Photo grey = slide::read_photo(data("grey.jpg"));
  check_size(grey.colour, 48, 32, 3);
  CHECK(grey.colour.at(5, 5, 0) == doctest::Approx(76 / 255.0).epsilon(0.02));
  CHECK(largest_error(grey.colour, [&](int x, int y, int) { return grey.colour.at(x, y, 0); }) == 0);
}

TEST_CASE("A CMYK JPEG is refused with the way out") {
  const std::string message = message_of([] { static_cast<void>(slide::read_photo(data("cmyk.jpg"))); });
  CHECK(contains(message, "cmyk.jpg"));
  CHECK(contains(message, "CMYK"));
  CHECK(contains(message, "convert it to RGB"));
}

TEST_CASE("PNG samples of 1, 8 and 16 bits are read exactly, interlaced or not") {
  const auto exact8 = [](int x, int y, int c) {
    return static_cast<double>(static_cast<float>(sample8(x, y, c)) / 255.0F);
  };
  const auto exact16 = [](int x, int y, int c) {
    return static_cast<double>(static_cast<float>(sample16(x, y, c)) / 65535.0F);
  };
  for (const char* name : {"rgb_8.png", "rgb_8_interlaced.png"}) {
    const Photo photo = slide::read_photo(data(name));
    check_size(photo.colour, 9, 7, 3);
    CHECK(photo.alpha.empty());
    CHECK(largest_error(photo.colour, exact8) == 0);
  }
  for (const char* name : {"rgb_16.png", "rgb_16_interlaced.png"}) {
    const Photo photo = slide::read_photo(data(name));
    check_size(photo.colour, 9, 7, 3);
    CHECK(largest_error(photo.colour, exact16) == 0);
  }
  const Image grey8 = slide::read_map(data("grey_8.png"));
  check_size(grey8, 9, 7, 1);
  CHECK(largest_error(grey8, exact8) == 0);
  const Image grey16 = slide::read_map(data("grey_16.png"));
  check_size(grey16, 9, 7, 1);
  CHECK(largest_error(grey16, exact16) == 0);
  const Image grey1 = slide::read_map(data("grey_1.png"));
  check_size(grey1, 13, 5, 1);
  CHECK(largest_error(grey1, [](int x, int y, int) { return (x * y + x) % 2; }) == 0);
}

TEST_CASE("Transparent pixels continue the opaque ones and the transparency is kept") {
  const Photo rgba = slide::read_photo(data("rgba_16.png"));
  check_size(rgba.colour, 9, 7, 3);
  check_size(rgba.alpha, 9, 7, 1);
  CHECK(largest_error(rgba.alpha, [](int x, int y, int) { return sample16(x, y, 3) / 65535.0; }) < 1e-7);
  // One colour and black under what is transparent: one colour everywhere. Two, half a picture apart: neither
  // the hidden colours nor anything outside of their range.
  Image cutout(37, 21, 4);
  for (int y = 0; y < 21; ++y)
    for (int x = 0; x < 37; ++x) {
      const float alpha = x < 8 ? 1.0F : x < 12 ? 0.6F : x < 30 ? 0.0F : 1.0F;
      cutout.at(x, y, 3) = alpha;
      for (int c = 0; c < 3; ++c) cutout.at(x, y, c) = alpha > 0 ? 0.2F * static_cast<float>(c + 1) : 0.0F;
    }
  const auto decoded = [&] { return slide::decode_photo(slide::encode_png(cutout, 16), "cutout"); };
  CHECK(largest_error(decoded().colour, [](int, int, int c) { return 0.2 * (c + 1); }) < 1e-5);
  for (int y = 0; y < 21; ++y)
    for (int x = 30; x < 37; ++x) cutout.at(x, y, 0) = 0.9F;
  const Image colour = decoded().colour;
  for (int y = 0; y < 21; ++y) {
    CHECK(colour.at(3, y, 0) == doctest::Approx(0.2).epsilon(1e-4));
    CHECK(colour.at(33, y, 0) == doctest::Approx(0.9).epsilon(1e-4));
    for (int x = 8; x < 30; ++x) {
      CHECK(colour.at(x, y, 0) > 0.199F);
      CHECK(colour.at(x, y, 0) < 0.901F);
    }
  }
}

TEST_CASE("A matte is the transparency of a file that has some, else its grey values") {
  const TemporaryFolder folder;
  Image white(5, 4, 4, 1.0F);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 5; ++x) white.at(x, y, 3) = static_cast<float>(x) / 4;
  slide::write_png(folder.file("alpha.png"), white, 16);
  CHECK(largest_error(slide::read_matte(folder.file("alpha.png")), [](int x, int, int) { return x / 4.0; }) <
        1e-5);
  CHECK(slide::read_matte(data("grey_16.png")).data == slide::read_map(data("grey_16.png")).data);
}

TEST_CASE("A palette with transparent entries is resolved") {
  const Photo photo = slide::read_photo(data("palette_4.png"));
  check_size(photo.colour, 9, 7, 3);
  const auto entry = [](int x, int y) { return (3 * x + 5 * y) % 16; };
  const auto alpha = [&](int x, int y) {
    return entry(x, y) == 0 ? 0.0 : entry(x, y) == 1 ? 128 / 255.0 : 1.0;
  };
  CHECK(largest_error(photo.alpha, [&](int x, int y, int) { return alpha(x, y); }) < 1e-7);
  CHECK(largest_error(photo.colour, [&](int x, int y, int c) {
          const int i = entry(x, y);
          const int colour = c == 0 ? i * 16 % 256 : c == 1 ? (255 - i * 16) % 256 : i * 7 % 256;
          return alpha(x, y) >= 1 ? colour / 255.0 : static_cast<double>(photo.colour.at(x, y, c));
        }) < 2e-7);
}

TEST_CASE("A PFM of either byte order is read from the bottom up") {
  const TemporaryFolder folder;
  // 2×2, bottom row 1.5, -2; top row 0.25, 3e8.
  const std::string little =
      std::string("Pf\n2 2\n-1.0\n") + std::string("\0\0\xC0\x3F\0\0\0\xC0\0\0\x80\x3E\xA3\xC4\x8F\x4D", 16);
  const std::string big =
      std::string("Pf\n2 2\n1.0\n") + std::string("\x3F\xC0\0\0\xC0\0\0\0\x3E\x80\0\0\x4D\x8F\xC4\xA3", 16);
  for (const std::string& text : {little, big}) {
    std::ofstream(folder.file("map.pfm"), std::ios::binary) << text;
    const Image map = slide::read_map(folder.file("map.pfm"));
    check_size(map, 2, 2, 1);
    CHECK(map.at(0, 0) == 0.25F);
    CHECK(map.at(1, 0) == 301503584.0F);
    CHECK(map.at(0, 1) == 1.5F);
    CHECK(map.at(1, 1) == -2.0F);
  }
}

TEST_CASE("The first NaN or infinite pixel of a map is named") {
  const TemporaryFolder folder;
  Image map(5, 4, 1, 0.5F);
  map.at(3, 3) = std::numeric_limits<float>::quiet_NaN();
  map.at(4, 1) = -std::numeric_limits<float>::infinity();
  slide::write_pfm(folder.file("m.pfm"), map);
  const auto read = [&] { static_cast<void>(slide::read_map(folder.file("m.pfm"))); };
  std::string message = message_of(read);
  CHECK(contains(message, "m.pfm"));
  CHECK(contains(message, "(4, 1)"));
  CHECK(contains(message, "infinite"));
  map.at(0, 0) = std::numeric_limits<float>::quiet_NaN();
  slide::write_pfm(folder.file("m.pfm"), map);
  message = message_of(read);
  CHECK(contains(message, "(0, 0)"));
  CHECK(contains(message, "NaN"));
}

TEST_CASE("A colour image is no map, three equal channels are") {
  CHECK(contains(message_of([] { static_cast<void>(slide::read_map(data("rgb_8.png"))); }), "colour"));
  const TemporaryFolder folder;
  Image grey(4, 3, 3);
  for (std::size_t i = 0; i < grey.data.size(); ++i) grey.data[i] = static_cast<float>(i / 3 * 20) / 255.0F;
  slide::write_png(folder.file("g.png"), grey);
  const Image map = slide::read_map(folder.file("g.png"));
  check_size(map, 4, 3, 1);
  CHECK(map.at(3, 2) == 220 / 255.0F);
}

TEST_CASE("The type is found from the content, not from the name") {
  const TemporaryFolder folder;
  const std::vector<std::uint8_t> bytes = slide::read_file(data("rgb_8.png"));
  slide::write_bytes(folder.file("photo.jpg"), bytes);
  CHECK(slide::read_photo(folder.file("photo.jpg")).colour.width == 9);
}

TEST_CASE("What is no image, no file or too large is refused by name") {
  const TemporaryFolder folder;
  CHECK(contains(message_of([&] { static_cast<void>(slide::read_photo(folder.file("none.jpg"))); }),
                 "none.jpg"));
  CHECK(contains(message_of([&] { static_cast<void>(slide::read_photo(folder.file(""))); }), "directory"));
  std::ofstream(folder.file("empty.png")).close();
  CHECK(
      contains(message_of([&] { static_cast<void>(slide::read_photo(folder.file("empty.png"))); }), "empty"));
  std::ofstream(folder.file("text.png")) << "This is a text, not a picture.\n";
  const std::string message =
      message_of([&] { static_cast<void>(slide::read_photo(folder.file("text.png"))); });
  CHECK(contains(message, "text.png"));
  // A header that promises 100000 × 7 pixels; its CRC is right.
  std::vector<std::uint8_t> wide = slide::read_file(data("rgb_8.png"));
  const std::vector<std::uint8_t> header = {0x00, 0x01, 0x86, 0xA0, 0,    0,    0,    7,   8,
                                            2,    0,    0,    0,    0x04, 0x45, 0x62, 0x9F};
  std::copy(header.begin(), header.end(), wide.begin() + 16);
  CHECK(contains(message_of([&] { static_cast<void>(slide::decode_photo(wide, "wide.png")); }),
                 "wide.png is 100000 x 7"));
  CHECK_NOTHROW(slide::check_image_size(16384, 8192, "x"));
  CHECK(contains(message_of([] { slide::check_image_size(30001, 1, "x"); }), "30001 x 1"));
  CHECK(contains(message_of([] { slide::check_image_size(16384, 8193, "x"); }), "16384 x 8193"));
  CHECK(contains(message_of([] { slide::check_image_size(0, 1, "x"); }), "no pixels"));
}

TEST_CASE("Devices and silent pipes are refused, the size is asked before pixels are allocated") {
  CHECK(contains(message_of([] { static_cast<void>(slide::read_photo("/dev/zero")); }), "a device"));
  const TemporaryFolder folder;
  if (!slide::test::quick()) {  // ten seconds
    REQUIRE(mkfifo(folder.file("pipe").c_str(), 0600) == 0);
    CHECK(contains(message_of([&] { static_cast<void>(slide::read_map(folder.file("pipe"))); }),
                   "for ten seconds"));
  }
  for (const char* name : {"rgb_8.png", "progressive.jpg"}) {
    std::pair<int, int> asked{0, 0};
    const auto refuse = [&](int width, int height) {
      asked = {width, height};
      throw slide::Error(slide::ErrorKind::kOutOfMemory, "too large");
    };
    CHECK(message_of([&] { static_cast<void>(slide::read_photo(data(name), refuse)); },
                     slide::ErrorKind::kOutOfMemory) == "too large");
    const Photo photo = slide::read_photo(data(name));
    CHECK(asked == std::pair<int, int>(photo.colour.width, photo.colour.height));
  }
}

TEST_CASE("The sizes of GIF and WebP are asked before their readers allocate") {
  if (!slide::has_openimageio()) return;
  using namespace std::string_literals;
  const TemporaryFolder folder;
  const std::pair<const char*, std::string> files[] = {
      {"gif", "GIF89a\xFF\x7F\xFF\x7F\x00\x00\x00;"s},
      {"extended.webp",
       "RIFF\x20\x00\x00\x00WEBPVP8X\x0A\x00\x00\x00\x00\x00\x00\x00\xFE\x7F\x00\xFE\x7F\x00"s},
      {"lossless.webp", "RIFF\x20\x00\x00\x00WEBPVP8L\x10\x00\x00\x00\x2F\xFF\xFF\xFF\x0F"s},
      {"lossy.webp",
       "RIFF\x20\x00\x00\x00WEBPVP8 \x10\x00\x00\x00\x00\x00\x00\x9D\x01\x2A\xFF\x3F\xFF\x3F"s}};
  for (const auto& file : files) {
    const std::string name = file.first;
    CAPTURE(name);
    write_bytes(folder.file(name), std::as_bytes(std::span(file.second)));
    const int side = name.starts_with("l") ? (name == "lossy.webp" ? 16383 : 16384) : 32767;
    CHECK(contains(message_of([&] { static_cast<void>(slide::read_photo(folder.file(name))); }),
                   std::to_string(side) + " x " + std::to_string(side)));
  }
}

TEST_CASE("Only the reader that the first bytes ask for sees a file") {
  if (!slide::has_openimageio()) return;
  const TemporaryFolder folder;
  for (const std::string content : {"DDS |", "SIMPLE  =", "DICM", "VDB ", "ftypisom"}) {
    write_bytes(folder.file("photo.jpg"), std::as_bytes(std::span(content)));
    CHECK(contains(message_of([&] { static_cast<void>(slide::read_photo(folder.file("photo.jpg"))); }),
                   "no format that photos or maps come in"));
  }
}

TEST_CASE("NumPy's arrays are maps") {
  using namespace std::string_literals;
  const TemporaryFolder folder;
  const auto write = [&](const std::string& shape, const std::vector<float>& values) {
    std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (" + shape + "), }";
    header.resize(118, ' ');
    std::string text = "\x93NUMPY\x01\x00\x76\x00"s + header;
    text.append(reinterpret_cast<const char*>(values.data()), 4 * values.size());
    write_bytes(folder.file("m.npy"), std::as_bytes(std::span(text)));
    return folder.file("m.npy");
  };
  for (const char* shape : {"2, 3", "1, 2, 3", "2, 3, 1"}) {
    const Image map = slide::read_map(write(shape, {1, 2, 3, 4, 5, -6.5F}));
    check_size(map, 3, 2, 1);
    CHECK(map.data == std::vector<float>{1, 2, 3, 4, 5, -6.5F});
  }
  CHECK(contains(message_of([&] {
                   static_cast<void>(slide::read_map(write("6,", {1, 2, 3, 4, 5, 6})));
                 }),
                 "height x width"));
  CHECK(contains(message_of([&] {
                   static_cast<void>(slide::read_map(
                       write("2, 3", {1, 2, 3, std::numeric_limits<float>::infinity(), 5, 6})));
                 }),
                 "(0, 1)"));
}

TEST_CASE("A text that claims 1.6 GB in a PNG takes no memory") {
  std::vector<std::uint8_t> png = slide::read_file(data("rgb_8.png"));
  const std::vector<std::uint8_t> text = {0x5F, 0x5E, 0x10, 0x00, 'i', 'T', 'X', 't', 'a', 0, 0, 0};
  png.insert(png.begin() + 33, text.begin(), text.end());  // behind the header
  CHECK_THROWS_AS(static_cast<void>(slide::decode_photo(png, "text.png")), slide::Error);
}

TEST_CASE("Every shortened file is an error, at every length at which pixels are missing") {
  for (const char* name : {"orientation_6.jpg", "progressive.jpg", "rgb_16_interlaced.png", "palette_4.png",
                           "orientation_8.png"}) {
    CAPTURE(name);
    const std::vector<std::uint8_t> bytes = slide::read_file(data(name));
    // A JPEG of one scan without its end marker (some cameras forget it) has every pixel.
    const bool one_scan = std::string(name) == "orientation_6.jpg";
    const std::size_t needed = bytes.size() - (one_scan ? 2 : 0);
    for (std::size_t length = 0; length < needed; ++length) {
      CAPTURE(length);
      const std::span<const std::uint8_t> part = std::span(bytes).first(length);
      CHECK_THROWS_AS(static_cast<void>(slide::decode_photo(part, name)), slide::Error);
    }
    for (std::size_t length = needed; length < bytes.size(); ++length)
      CHECK(slide::decode_photo(std::span(bytes).first(length), name).colour.data ==
            slide::decode_photo(bytes, name).colour.data);
  }
  Image map(3, 2, 1, 0.5F);
  const std::vector<std::uint8_t> pfm = slide::encode_pfm(map);
  for (std::size_t length = 0; length < pfm.size(); ++length) {
    CHECK_THROWS_AS(static_cast<void>(slide::decode_map(std::span(pfm).first(length), "m")), slide::Error);
  }
}

TEST_CASE("A flipped bit anywhere gives a picture of allowed size or an error, nothing else") {
  for (const char* name : {"orientation_5.jpg", "focal_plane.jpg", "progressive.jpg", "rgb_16_interlaced.png",
                           "palette_4.png", "orientation_8.png"}) {
    CAPTURE(name);
    const std::vector<std::uint8_t> original = slide::read_file(data(name));
    int refused = 0;
    for (std::size_t bit = 0; bit < 8 * original.size(); ++bit) {
      std::vector<std::uint8_t> bytes = original;
      bytes[bit / 8] = static_cast<std::uint8_t>(bytes[bit / 8] ^ 1U << bit % 8);
      try {
        const Photo photo = slide::decode_photo(bytes, name);
        CHECK(photo.colour.width <= slide::kMaxImageSide);
      } catch (const slide::Error&) {
        ++refused;
      }
    }
    CHECK(refused > 0);
  }
}

TEST_CASE("Damage in EXIF never fails") {
  const std::vector<std::uint8_t> original = slide::read_file(data("focal_plane.jpg"));
  const std::string mark = "Exif";
  const auto found = std::search(original.begin(), original.end(), mark.begin(), mark.end());
  REQUIRE(found != original.end());
  const std::vector<std::uint8_t> block(found + 6, found + 6 + 140);
  CHECK(slide::parse_exif(block).focal_length_mm == 5.0);
  for (std::size_t length = 0; length <= block.size(); ++length) {
    const std::vector<std::uint8_t> part(block.begin(), block.begin() + static_cast<std::ptrdiff_t>(length));
    CHECK(slide::parse_exif(part).orientation == 1);
  }
  for (std::size_t bit = 0; bit < 8 * block.size(); ++bit) {
    std::vector<std::uint8_t> bytes = block;
    bytes[bit / 8] = static_cast<std::uint8_t>(bytes[bit / 8] ^ 1U << bit % 8);
    const slide::Exif exif = slide::parse_exif(bytes);
    CHECK(exif.orientation >= 1);
    CHECK(exif.orientation <= 8);
  }
}

TEST_CASE("A volume is refused, not written behind the picture's end") {
  // A DirectDraw Surface of 4x4 pixels and 64 slices of 32-bit colour.
  std::string dds(128, '\0');
  const auto put = [&dds](std::size_t offset, std::uint32_t value) {
    for (std::size_t i = 0; i < 4; ++i) dds[offset + i] = static_cast<char>(value >> (8 * i) & 0xFF);
  };
  dds.replace(0, 4, "DDS ");
  put(4, 124);           // size of the header
  put(8, 0x80100F);      // caps, height, width, pitch, pixel format, depth
  put(12, 4);            // height
  put(16, 4);            // width
  put(20, 16);           // pitch
  put(24, 64);           // depth
  put(76, 32);           // size of the pixel format
  put(80, 0x41);         // RGB with alpha
  put(88, 32);           // bits
  put(92, 0xFF0000);     // red
  put(96, 0xFF00);       // green
  put(100, 0xFF);        // blue
  put(104, 0xFF000000);  // alpha
  put(108, 0x401008);    // texture, complex, mipmap
  put(112, 0x200000);    // a volume
  dds.append(std::size_t{4} * 4 * 4 * 64, 'x');
  const TemporaryFolder folder;
  const std::string path = folder.file("volume.jpg");
  std::ofstream(path, std::ios::binary) << dds;
  CHECK_THROWS_AS((void)slide::read_photo(path), slide::Error);
  CHECK_THROWS_AS((void)slide::read_map(path), slide::Error);
}

TEST_CASE("Of an EXR with colours and depth the depth is the map") {
  if (!slide::has_openimageio()) return;
  // OpenEXR's file layout: magic and version, attributes, a table of offsets, and scan lines whose channels
  // come in alphabetical order; nothing compressed. 2×2 pixels.
  std::string file("\x76\x2F\x31\x01\x02\0\0\0", 8);
  const auto number = [](std::uint64_t value, int bytes) {
    std::string text;
    for (int i = 0; i < bytes; ++i) text += static_cast<char>(value >> (8 * i) & 0xFFU);
    return text;
  };
  const auto real = [&](float value) { return number(std::bit_cast<std::uint32_t>(value), 4); };
  const auto attribute = [&](const std::string& name, const std::string& type, const std::string& value) {
    file += name + '\0' + type + '\0' + number(value.size(), 4) + value;
  };
  const std::vector<std::string> names = {"B", "G", "R", "View.Depth.Z"};
  std::string channels;
  for (const std::string& name : names)
    channels += name + '\0' + number(2, 4) + number(0, 4) + number(1, 4) + number(1, 4);
  const std::string window = number(0, 4) + number(0, 4) + number(1, 4) + number(1, 4);
  attribute("channels", "chlist", channels + '\0');
  attribute("compression", "compression", std::string(1, '\0'));
  attribute("dataWindow", "box2i", window);
  attribute("displayWindow", "box2i", window);
  attribute("lineOrder", "lineOrder", std::string(1, '\0'));
  attribute("pixelAspectRatio", "float", real(1));
  attribute("screenWindowCenter", "v2f", real(0) + real(0));
  attribute("screenWindowWidth", "float", real(1));
  file += '\0';
  constexpr std::size_t kLine = 8 + 4 * 2 * 4;
  const std::size_t first = file.size() + 16;
  file += number(first, 8) + number(first + kLine, 8);
  for (int y = 0; y < 2; ++y) {
    file += number(static_cast<std::uint64_t>(y), 4) + number(kLine - 8, 4);
    for (int c = 0; c < 4; ++c)
      for (int x = 0; x < 2; ++x) file += real(static_cast<float>(100 * c + 10 * y + x));
  }
  const TemporaryFolder folder;
  slide::write_bytes(folder.file("z.exr"), std::vector<std::uint8_t>(file.begin(), file.end()));
  const Image map = slide::read_map(folder.file("z.exr"));
  check_size(map, 2, 2, 1);
  CHECK(map.data == std::vector<float>{300, 301, 310, 311});
  CHECK(slide::read_photo(folder.file("z.exr")).colour.channels == 3);
}

TEST_CASE("EXR is read and written in the full build, and named as missing in others") {
  const TemporaryFolder folder;
  Image map(5, 3, 1);
  for (std::size_t i = 0; i < map.data.size(); ++i) map.data[i] = static_cast<float>(i) * 1.7F - 3;
  if (!slide::has_openimageio()) {
    CHECK(contains(message_of([&] { slide::write_exr(folder.file("m.exr"), map); }, slide::ErrorKind::kUsage),
                   "OpenEXR"));
    const std::vector<std::uint8_t> exr_magic = {0x76, 0x2F, 0x31, 0x01, 2, 0, 0, 0};
    slide::write_bytes(folder.file("m.exr"), exr_magic);
    CHECK(contains(message_of([&] { static_cast<void>(slide::read_map(folder.file("m.exr"))); }),
                   "SLIDE_OPENIMAGEIO"));
    return;
  }
  slide::write_exr(folder.file("m.exr"), map);
  const Image read = slide::read_map(folder.file("m.exr"));
  check_size(read, 5, 3, 1);
  CHECK(read.data == map.data);
  map.at(2, 1) = std::numeric_limits<float>::quiet_NaN();
  slide::write_exr(folder.file("m.exr"), map);
  CHECK(contains(message_of([&] { static_cast<void>(slide::read_map(folder.file("m.exr"))); }), "(2, 1)"));
  // Linear light in a photo becomes sRGB: 0.214 is the middle of the encoded range.
  slide::write_exr(folder.file("p.exr"), Image(2, 2, 3, 0.21404114F));
  CHECK(slide::read_photo(folder.file("p.exr")).colour.at(1, 1, 2) == doctest::Approx(0.5).epsilon(1e-5));
  slide::write_bytes(folder.file("bad.exr"), std::vector<std::uint8_t>{0x76, 0x2F, 0x31, 0x01, 2, 0, 0, 0});
  CHECK(contains(message_of([&] { static_cast<void>(slide::read_map(folder.file("bad.exr"))); }), "bad.exr"));
}
