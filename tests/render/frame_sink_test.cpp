#include "render/frame_sink.h"

#include <doctest/doctest.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <numbers>
#include <thread>

#include "render/codec.h"
#include "render/gif.h"
#include "render/image_file.h"
#include "render/palette.h"
#include "render/write_image.h"
#include "render/y4m.h"
#include "runtime/error.h"
#include "runtime/threads.h"
#include "tests/render/decoders.h"
#include "tests/temporary_folder.h"

namespace {

using slide::Image;

/// A smooth colour scene with a disc that moves with the frame.
Image test_frame(int width, int height, int frame) {
  Image image(width, height, 3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double dx = x - width * (0.3 + 0.04 * frame);
      const double dy = y - height * 0.5;
      const bool disc = dx * dx + dy * dy < height * height / 12.0;
      image.at(x, y, 0) = disc ? 0.9F : static_cast<float>(x) / static_cast<float>(width);
      image.at(x, y, 1) = disc ? 0.3F : static_cast<float>(y) / static_cast<float>(height);
      image.at(x, y, 2) = disc ? 0.1F : 0.5F;
    }
  }
  return image;
}

void write_frames(const std::string& path, const slide::FrameFormat& format) {
  const auto sink = slide::make_frame_sink(path);
  sink->begin(format);
  for (int i = 0; i < format.count; ++i) sink->frame(test_frame(format.width, format.height, i));
  sink->finish();
}

std::string usage_message(const std::function<void()>& action,
                          slide::ErrorKind kind = slide::ErrorKind::kUsage) {
  try {
    action();
  } catch (const slide::Error& e) {
    CHECK(e.kind() == kind);
    return e.what();
  }
  return "no error";
}

std::string output_message(const std::function<void()>& action) {
  return usage_message(action, slide::ErrorKind::kOutput);
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// Puts another value into an environment variable until the end of the scope.
class ScopedVariable {
 public:
  ScopedVariable(const char* name, const std::string& value) : name_(name) {
    const char* old = std::getenv(name);
    old_ = old != nullptr ? old : "";
    ::setenv(name, value.c_str(), 1);
  }
  ~ScopedVariable() { ::setenv(name_.c_str(), old_.c_str(), 1); }
  ScopedVariable(const ScopedVariable&) = delete;
  ScopedVariable& operator=(const ScopedVariable&) = delete;

 private:
  std::string name_, old_;
};

void write_script(const std::string& path, const std::string& text) {
  std::ofstream(path) << "#!/bin/sh\n" << text;
  REQUIRE(::chmod(path.c_str(), 0755) == 0);
}

}  // namespace

TEST_CASE("A PNG of any channel count and depth holds the rounded samples") {
  for (const int channels : {1, 2, 3, 4}) {
    for (const int bits : {8, 16}) {
      CAPTURE(channels);
      CAPTURE(bits);
      Image image(7, 5, channels);
      for (std::size_t i = 0; i < image.data.size(); ++i)
        image.data[i] = -0.2F + 0.013F * static_cast<float>(i);
      image.data[3] = std::nanf("");
      const DecodedPng png = independent_png(slide::encode_png(image, bits));
      CHECK(png.width == 7);
      CHECK(png.height == 5);
      CHECK(png.channels == channels);
      REQUIRE(png.bits == bits);
      REQUIRE(png.samples.size() == image.data.size());
      const double top = bits == 8 ? 255 : 65535;
      for (std::size_t i = 0; i < image.data.size(); ++i) {
        const double v = std::isnan(image.data[i]) ? 0 : std::clamp<double>(image.data[i], 0, 1);
        CHECK(std::abs(png.samples[i] - v * top) <=
              0.5 + 0.005);  // the half of a step, and float32's rounding
      }
    }
  }
}

TEST_CASE("Every 16-bit sample survives writing and reading a PNG") {
  Image image(256, 256, 1);
  for (std::size_t i = 0; i < image.data.size(); ++i) image.data[i] = static_cast<float>(i) / 65535.0F;
  const Image read = slide::decode_map(slide::encode_png(image, 16), "all.png");
  CHECK(read.data == image.data);
}

TEST_CASE("A PFM holds the floats bit by bit") {
  Image image(3, 2, 3);
  for (std::size_t i = 0; i < image.data.size(); ++i)
    image.data[i] = std::ldexp(1.1F, static_cast<int>(i) * 7 - 60);
  const std::vector<std::uint8_t> bytes = slide::encode_pfm(image);
  const std::string header(bytes.begin(), bytes.begin() + 12);
  CHECK(header == "PF\n3 2\n-1.0\n");
  CHECK(slide::decode_pfm(bytes, "x").data == image.data);
}

TEST_CASE("A JPEG of quality 92 is close to the image") {
  const Image image = test_frame(64, 48, 0);
  const Image read = slide::decode_photo(slide::encode_jpeg(image, 92), "x.jpg").colour;
  REQUIRE(read.data.size() == image.data.size());
  double sum = 0;
  for (std::size_t i = 0; i < image.data.size(); ++i) sum += std::pow(read.data[i] - image.data[i], 2);
  CHECK(10 * std::log10(static_cast<double>(image.data.size()) / sum) > 38);  // dB
}

TEST_CASE("A still image is written in the format its name ends with") {
  const TemporaryFolder folder;
  const Image image = test_frame(8, 6, 0);
  for (const char* name : {"a.png", "a.jpg", "a.JPEG", "a.pfm"}) {
    slide::write_image(folder.file(name), image);
    CHECK(std::filesystem::file_size(folder.file(name)) > 20);
  }
  CHECK(contains(usage_message([&] { slide::write_image(folder.file("a.bmp"), image); }), ".png"));
  CHECK(
      contains(output_message([&] { slide::write_image(folder.file("none/a.png"), image); }), "none/a.png"));
  CHECK(folder.entries() == 4);
}

TEST_CASE("LZW gives back its input through table growth, clearing and every end") {
  std::uint32_t state = 1;
  for (const int alphabet : {1, 2, 7, 256}) {
    for (const std::size_t length :
         {0UL, 1UL, 2UL, 3UL, 255UL, 256UL, 257UL, 511UL, 513UL, 4000UL, 60001UL}) {
      CAPTURE(alphabet);
      CAPTURE(length);
      std::vector<std::uint8_t> symbols(length);
      for (auto& s : symbols) {
        state = state * 1664525U + 1013904223U;
        s = static_cast<std::uint8_t>((state >> 16U) % static_cast<unsigned>(alphabet));
      }
      CHECK(independent_lzw(slide::lzw_compress(symbols), length) == symbols);
    }
  }
  // Every length around the points where codes widen and the table fills.
  std::vector<std::uint8_t> symbols;
  for (std::size_t i = 0; i < 5000; ++i) symbols.push_back(static_cast<std::uint8_t>(i * i / 7 % 251));
  for (std::size_t length = 200; length<5000; length += length> 300 && length < 3700 ? 37 : 1) {
    const auto part = std::span(symbols).first(length);
    const std::vector<std::uint8_t> decoded = independent_lzw(slide::lzw_compress(part), length);
    REQUIRE(std::equal(part.begin(), part.end(), decoded.begin(), decoded.end()));
  }
}

TEST_CASE("A palette of as many colours as occur is exact, and a smaller one represents them") {
  const std::vector<slide::Rgb8> colours = {
      {0, 0, 0}, {255, 0, 0}, {0, 255, 0}, {20, 30, 240}, {255, 255, 255}};
  slide::ColourHistogram histogram;
  for (const auto& c : colours) histogram.add(c);
  std::vector<slide::Rgb8> palette = slide::make_palette(histogram, 255);
  REQUIRE(palette.size() == colours.size());
  for (const auto& c : colours) CHECK(std::find(palette.begin(), palette.end(), c) != palette.end());
  CHECK(slide::make_palette(histogram, 2).size() == 2);
  CHECK(slide::make_palette(slide::ColourHistogram(), 255).size() == 1);
}

TEST_CASE("The dither keeps the mean of an even colour and depends on nothing but colour and place") {
  slide::PatternDither dither({{0, 0, 0}, {90, 90, 90}, {170, 170, 170}, {255, 255, 255}});
  const int levels[] = {0, 90, 170, 255};
  for (const int grey : {0, 20, 64, 100, 130, 200, 255}) {
    CAPTURE(grey);
    const std::vector<std::uint8_t> rgb(3 * 64, static_cast<std::uint8_t>(grey));
    std::vector<std::uint8_t> indices(64, 99);
    dither.map(rgb, 8, indices);
    double mean = 0;
    for (const std::uint8_t i : indices) mean += levels[i] / 64.0;
    CHECK(std::abs(mean - grey) <
          8);  // a sixteenth of a step between colours, and the error that is not carried
    std::vector<std::uint8_t> again(64, 99);
    dither.map(rgb, 8, again);
    CHECK(indices == again);
  }
}

TEST_CASE("A GIF shows the frames, in time, endlessly, and what stands still does not change") {
  const TemporaryFolder folder;
  const std::string path = folder.file("a.gif");
  write_frames(path, {48, 32, 30, 7});
  const DecodedGif gif = independent_gif(slide::read_file(path));
  CHECK(gif.width == 48);
  CHECK(gif.height == 32);
  CHECK(gif.loops == 0);
  CHECK(gif.delays == std::vector<int>{3, 4, 3, 3, 4, 3, 3});  // frame i ends at round(100 (i + 1) / 30)
  REQUIRE(gif.frames.size() == 7);
  for (int f = 0; f < 7; ++f) {
    const std::vector<std::uint8_t> wanted = slide::to_samples(test_frame(48, 32, f), 8);
    double sum = 0;
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      sum += std::pow(wanted[i] - gif.frames[static_cast<std::size_t>(f)][i], 2);
    }
    CHECK(std::sqrt(sum / static_cast<double>(wanted.size())) <
          8);  // of 255; 1536 colours on a palette of 255
  }
  // The right quarter is never covered by the disc.
  for (int y = 0; y < 32; ++y) {
    for (int x = 40; x < 48; ++x) {
      const auto i = static_cast<std::size_t>((y * 48 + x) * 3);
      CHECK(std::equal(gif.frames[0].begin() + static_cast<std::ptrdiff_t>(i),
                       gif.frames[0].begin() + static_cast<std::ptrdiff_t>(i + 3),
                       gif.frames[6].begin() + static_cast<std::ptrdiff_t>(i)));
    }
  }
  CHECK(folder.entries() == 1);
  CHECK(contains(usage_message([&] { write_frames(path, {8, 8, 60, 2}); }), "50 frames"));
}

TEST_CASE("A GIF has the same bytes at any thread count") {
  const TemporaryFolder folder;
  slide::set_thread_count(1);
  write_frames(folder.file("1.gif"), {40, 30, 25, 3});
  slide::set_thread_count(5);
  write_frames(folder.file("5.gif"), {40, 30, 25, 3});
  slide::set_thread_count(0);
  CHECK(slide::read_file(folder.file("1.gif")) == slide::read_file(folder.file("5.gif")));
}

TEST_CASE("An APNG holds every frame exactly, in time, endlessly") {
  const TemporaryFolder folder;
  for (const char* name : {"a.png", "a.apng"}) {
    write_frames(folder.file(name), {33, 21, 29.97, 4});
    const DecodedApng apng = independent_apng(slide::read_file(folder.file(name)));
    CHECK(apng.plays == 0);
    REQUIRE(apng.frames.size() == 4);
    for (int f = 0; f < 4; ++f) {
      const auto i = static_cast<std::size_t>(f);
      CHECK(apng.delay_numerators[i] == 1001);
      CHECK(apng.delay_denominators[i] == 30000);
      const std::vector<std::uint8_t> wanted = slide::to_samples(test_frame(33, 21, f), 8);
      CHECK(std::equal(wanted.begin(), wanted.end(), apng.frames[i].samples.begin(),
                       apng.frames[i].samples.end()));
    }
    // A program that does not know animation sees the first frame.
    CHECK(independent_png(slide::read_file(folder.file(name))).samples == apng.frames[0].samples);
  }
  write_frames(folder.file("one.png"), {33, 21, 30, 1});
  CHECK(slide::read_file(folder.file("one.png")) == slide::encode_png(test_frame(33, 21, 0), 8));
}

TEST_CASE("A Y4M stream has BT.709's closed-form values for colours known from tables") {
  CHECK(slide::y4m_header({1920, 1080, 30, 1}) ==
        "YUV4MPEG2 W1920 H1080 F30:1 Ip A1:1 C444 XCOLORRANGE=LIMITED\n");
  CHECK(slide::y4m_header({2, 2, 23.976, 1}) ==
        "YUV4MPEG2 W2 H2 F24000:1001 Ip A1:1 C444 XCOLORRANGE=LIMITED\n");
  CHECK(slide::y4m_header({2, 2, 12.5, 1}) == "YUV4MPEG2 W2 H2 F25:2 Ip A1:1 C444 XCOLORRANGE=LIMITED\n");
  // The 100 % colour bars of BT.709 in 8 bits: white, yellow, cyan, green, magenta, red, blue, black.
  const std::vector<std::vector<float>> rgb = {{1, 1, 1}, {1, 1, 0}, {0, 1, 1}, {0, 1, 0},
                                               {1, 0, 1}, {1, 0, 0}, {0, 0, 1}, {0, 0, 0}};
  const std::vector<std::vector<int>> yuv = {{235, 128, 128}, {219, 16, 138}, {188, 154, 16}, {173, 42, 26},
                                             {78, 214, 230},  {63, 102, 240}, {32, 240, 118}, {16, 128, 128}};
  Image bars(8, 1, 3);
  for (int x = 0; x < 8; ++x) {
    for (int c = 0; c < 3; ++c)
      bars.at(x, 0, c) = rgb[static_cast<std::size_t>(x)][static_cast<std::size_t>(c)];
  }
  const std::vector<std::uint8_t> frame = slide::y4m_frame(bars);
  REQUIRE(frame.size() == 6 + 24);
  CHECK(std::string(frame.begin(), frame.begin() + 6) == "FRAME\n");
  for (std::size_t x = 0; x < 8; ++x) {
    for (std::size_t c = 0; c < 3; ++c) CHECK(frame[6 + 8 * c + x] == yuv[x][c]);
  }
}

TEST_CASE("A Y4M file and a named pipe get the same bytes") {
  const TemporaryFolder folder;
  write_frames(folder.file("a.y4m"), {10, 6, 24, 3});
  const std::vector<std::byte> file = bytes_of_file(folder.file("a.y4m"));
  CHECK(file.size() == slide::y4m_header({10, 6, 24, 3}).size() + 3 * (6 + 180));
  const std::string fifo = folder.file("pipe.y4m");
  REQUIRE(::mkfifo(fifo.c_str(), 0600) == 0);
  std::vector<std::byte> piped;
  std::thread reader([&] { piped = bytes_of_file(fifo); });
  write_frames(fifo, {10, 6, 24, 3});
  reader.join();
  CHECK(piped == file);
}

TEST_CASE("A name without extension is a folder of PNG frames") {
  const TemporaryFolder folder;
  write_frames(folder.file("new/frames/"), {12, 9, 30, 3});
  for (int f = 0; f < 3; ++f) {
    const std::string name = folder.file("new/frames/frame_000" + std::to_string(f) + ".png");
    CHECK(slide::read_file(name) == slide::encode_png(test_frame(12, 9, f), 8));
  }
}

TEST_CASE("An unknown extension is refused with the ones that are known") {
  const std::string message = usage_message([] { static_cast<void>(slide::make_frame_sink("a.avi")); });
  for (const char* part : {"a.avi", ".gif", ".png", ".mp4", ".webm", ".y4m"}) CHECK(contains(message, part));
  CHECK(slide::is_frame_output("x.GIF"));
  CHECK_FALSE(slide::is_frame_output("x.txt"));
}

TEST_CASE("Frames that do not fit the announcement are refused, and an unfinished sink leaves no file") {
  const TemporaryFolder folder;
  for (const char* name : {"a.gif", "a.png", "a.y4m"}) {
    const auto sink = slide::make_frame_sink(folder.file(name));
    sink->begin({8, 8, 30, 1});
    CHECK_THROWS_AS(sink->frame(Image(9, 8, 3)), slide::Error);
    CHECK_THROWS_AS(sink->finish(), slide::Error);
    sink->frame(Image(8, 8, 3));
    CHECK_THROWS_AS(sink->frame(Image(8, 8, 3)), slide::Error);
  }
  CHECK(folder.entries() == 0);
  CHECK_THROWS_AS(slide::make_frame_sink(folder.file("a.gif"))->begin({8, 8, std::nan(""), 1}), slide::Error);
  CHECK_THROWS_AS(slide::make_frame_sink(folder.file("a.gif"))->begin({0, 8, 30, 1}), slide::Error);
}

TEST_CASE("Video is what the ffmpeg on PATH made of the stream, under the name asked for") {
  const TemporaryFolder folder;
  const ScopedVariable path("PATH", folder.path().string() + ":/usr/bin:/bin");
  // Stands in for ffmpeg: copies its input to the file that its last argument names.
  write_script(folder.file("ffmpeg"), "for last; do :; done\nexec cat > \"${last#file:}\"\n");
  for (const char* name : {"a.mp4", "a.webm"}) {
    write_frames(folder.file(name), {10, 6, 24, 3});
    write_frames(folder.file("a.y4m"), {10, 6, 24, 3});
    CHECK(slide::read_file(folder.file(name)) == slide::read_file(folder.file("a.y4m")));
  }
  CHECK(folder.entries() == 4);
}

TEST_CASE("No ffmpeg, one that fails and one that stops reading each give a clear message and no file") {
  const TemporaryFolder folder;
  const std::string video = folder.file("a.mp4");
  {
    const ScopedVariable path("PATH", folder.path().string());
    const std::string message = usage_message([&] { write_frames(video, {64, 64, 24, 3}); });
    CHECK(contains(message, "ffmpeg was not found on PATH"));
    CHECK(contains(message, ".gif"));
  }
  const ScopedVariable path("PATH", folder.path().string() + ":/usr/bin:/bin");
  write_script(folder.file("ffmpeg"), "cat > /dev/null\necho 'Unknown encoder' >&2\nexit 3\n");
  const std::string failed = output_message([&] { write_frames(video, {64, 64, 24, 3}); });
  CHECK(contains(failed, "exit status 3"));
  CHECK(contains(failed, "Unknown encoder"));
  // Frames of many times what a socket holds, so that writing meets the closed end.
  write_script(folder.file("ffmpeg"), "echo 'Out of patience' >&2\nexit 1\n");
  const std::string stopped = output_message([&] { write_frames(video, {640, 480, 24, 5}); });
  CHECK(contains(stopped, "Out of patience"));
  write_script(folder.file("ffmpeg"), "exit 0\n");
  CHECK(contains(output_message([&] { write_frames(video, {640, 480, 24, 5}); }), "stopped reading"));
  // As ffmpeg does where the disk is full: it complains, leaves a broken file and ends with 0.
  write_script(folder.file("ffmpeg"),
               "for last; do :; done\nhead -c 100 > \"${last#file:}\"\ncat > /dev/null\n"
               "echo 'av_interleaved_write_frame(): No space left on device' >&2\n");
  CHECK(contains(output_message([&] { write_frames(video, {64, 64, 24, 3}); }), "No space left"));
  write_script(folder.file("ffmpeg"), "cat > /dev/null\n");
  CHECK(contains(output_message([&] { write_frames(video, {64, 64, 24, 3}); }), "wrote nothing"));
  CHECK(folder.entries() == 1);  // the script
}

TEST_CASE("An ffmpeg that is on PATH makes MP4 with its index at the front, and WebM") {
  const TemporaryFolder folder;
  try {
    write_frames(folder.file("a.mp4"), {33, 21, 24, 3});
    write_frames(folder.file("a.webm"), {33, 21, 24, 3});
  } catch (const slide::Error& e) {
    REQUIRE(contains(e.what(), "ffmpeg was not found on PATH"));
    MESSAGE("no ffmpeg here");
    return;
  }
  const std::vector<std::uint8_t> mp4 = slide::read_file(folder.file("a.mp4"));
  const auto place = [&mp4](const std::string& box) {
    return std::search(mp4.begin(), mp4.end(), box.begin(), box.end()) - mp4.begin();
  };
  CHECK(place("ftyp") == 4);
  CHECK(place("moov") < place("mdat"));
  CHECK(place("mdat") < static_cast<std::ptrdiff_t>(mp4.size()));
  const std::vector<std::uint8_t> webm = slide::read_file(folder.file("a.webm"));
  REQUIRE(webm.size() > 100);
  CHECK(std::vector<std::uint8_t>(webm.begin(), webm.begin() + 4) ==
        std::vector<std::uint8_t>{0x1A, 0x45, 0xDF, 0xA3});
  CHECK(folder.entries() == 2);
}
