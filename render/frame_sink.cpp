#include "render/frame_sink.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <system_error>

#include "render/apng.h"
#include "render/ffmpeg.h"
#include "render/gif.h"
#include "render/write_image.h"
#include "render/y4m.h"
#include "runtime/error.h"

namespace slide {
namespace {

class PngFolderSink : public FrameSink {
 public:
  explicit PngFolderSink(std::string folder) : folder_(std::move(folder)) {}

 private:
  void do_begin() override {
    std::error_code code;
    std::filesystem::create_directories(folder_, code);
    if (code) throw Error(ErrorKind::kOutput, "cannot make the folder " + folder_ + ": " + code.message());
  }
  void do_frame(const Image& image) override {
    std::array<char, 32> name{};
    std::snprintf(name.data(), name.size(), "frame_%04d.png", frames_before());
    write_png((std::filesystem::path(folder_) / name.data()).string(), image);
  }
  void do_finish() override {}

  std::string folder_;
};

bool names_folder(const std::string& path) {
  std::error_code code;
  return path.ends_with('/') || lower_extension(path).empty() || std::filesystem::is_directory(path, code);
}

std::unique_ptr<FrameSink> find_frame_sink(const std::string& path) {
  if (path == "-") return make_y4m_sink(path);
  if (path.empty()) return nullptr;
  if (names_folder(path)) return std::make_unique<PngFolderSink>(path);
  const std::string extension = lower_extension(path);
  if (extension == ".gif") return make_gif_sink(path);
  if (extension == ".png" || extension == ".apng") return make_apng_sink(path);
  if (extension == ".y4m") return make_y4m_sink(path);
  if (extension == ".mp4" || extension == ".webm") return make_ffmpeg_sink(path);
  return nullptr;
}

}  // namespace

void FrameSink::begin(const FrameFormat& format) {
  if (format.width < 1 || format.height < 1 || format.count < 1) {
    throw Error(ErrorKind::kUsage, "a sequence of frames needs at least one frame of at least one pixel");
  }
  if (!std::isfinite(format.fps) || format.fps < 0.01 || format.fps > 1000) {
    throw Error(ErrorKind::kUsage, "the frame rate must lie between 0.01 and 1000 frames per second");
  }
  format_ = format;
  taken_ = 0;
  do_begin();
}

void FrameSink::frame(const Image& image) {
  if (image.width != format_.width || image.height != format_.height || image.channels != 3) {
    throw Error(ErrorKind::kInternal,
                "a frame of " + std::to_string(image.width) + " x " + std::to_string(image.height) + " x " +
                    std::to_string(image.channels) + " does not belong to the sequence");
  }
  if (taken_ >= format_.count) throw Error(ErrorKind::kInternal, "more frames came than were announced");
  do_frame(image);
  ++taken_;
}

void FrameSink::finish() {
  if (taken_ != format_.count) throw Error(ErrorKind::kInternal, "fewer frames came than were announced");
  do_finish();
}

std::unique_ptr<FrameSink> make_frame_sink(const std::string& path) {
  std::unique_ptr<FrameSink> sink = find_frame_sink(path);
  if (sink) return sink;
  throw Error(
      ErrorKind::kUsage, "cannot tell from its name what kind of output " + path + " is to be",
      "end it in .gif, .png (APNG), .mp4, .webm or .y4m, use - for uncompressed video on standard output, or "
      "end it in / for a folder of PNG frames");
}

bool is_frame_output(const std::string& path) { return find_frame_sink(path) != nullptr; }

}  // namespace slide
