#include "render/ffmpeg.h"

#include <filesystem>
#include <span>
#include <system_error>
#include <vector>

#include "render/child_process.h"
#include "render/write_image.h"
#include "render/y4m.h"
#include "runtime/atomic_file.h"
#include "runtime/error.h"

namespace slide {
namespace {

std::vector<std::string> command(const std::string& extension, const std::string& destination) {
  std::vector<std::string> arguments = {"ffmpeg", "-hide_banner", "-nostats", "-loglevel", "error", "-xerror",
                                        "-y", "-f", "yuv4mpegpipe", "-i", "pipe:0",
                                        // The size of a view is kept to the pixel; scaling would blur it.
                                        "-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2:0:0", "-pix_fmt", "yuv420p",
                                        "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc",
                                        "iec61966-2-1", "-color_range", "tv"};
  const std::vector<std::string> mp4 = {"-c:v", "libx264",   "-preset",    "medium", "-crf",
                                        "18",   "-movflags", "+faststart", "-f",     "mp4"};
  const std::vector<std::string> webm = {"-c:v", "libvpx-vp9", "-b:v", "0",  "-crf",
                                         "30",   "-row-mt",    "1",    "-f", "webm"};
  const std::vector<std::string>& codec = extension == ".webm" ? webm : mp4;
  arguments.insert(arguments.end(), codec.begin(), codec.end());
  arguments.push_back("file:" + destination);
  return arguments;
}

class FfmpegSink : public FrameSink {
 public:
  explicit FfmpegSink(const std::string& path) : path_(path) {}

 private:
  void do_begin() override {
    if (format().width < 2 || format().height < 2) {
      throw Error(ErrorKind::kUsage, "a video needs at least 2 x 2 pixels");
    }
    file_ = std::make_unique<AtomicFile>(path_);
    ffmpeg_ = std::make_unique<ChildProcess>(
        command(lower_extension(path_), file_->temporary_path()),
        "install ffmpeg, or write .gif, .png (APNG) or .y4m, which need no other program");
    const std::string header = y4m_header(format());
    feed(std::as_bytes(std::span(header)));
  }
  void do_frame(const Image& image) override {
    const std::vector<std::uint8_t> bytes = y4m_frame(image);
    feed(std::as_bytes(std::span(bytes)));
  }
  void do_finish() override {
    ffmpeg_->wait();
    std::error_code code;
    if (std::filesystem::file_size(file_->temporary_path(), code) == 0 || code)
      throw Error(ErrorKind::kOutput, "ffmpeg wrote nothing to " + path_);
    file_->commit();
  }
  void feed(std::span<const std::byte> bytes) {
    if (ffmpeg_->write(bytes)) return;
    ffmpeg_->wait();  // throws with the reason
    throw Error(ErrorKind::kOutput, "ffmpeg stopped reading before the last frame of " + path_);
  }

  std::string path_;
  // The program ends before the file it writes is removed: members are destroyed last to first.
  std::unique_ptr<AtomicFile> file_;
  std::unique_ptr<ChildProcess> ffmpeg_;
};

}  // namespace

std::unique_ptr<FrameSink> make_ffmpeg_sink(const std::string& path) {
  return std::make_unique<FfmpegSink>(path);
}

}  // namespace slide
