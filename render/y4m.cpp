#include "render/y4m.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <filesystem>
#include <numeric>
#include <span>
#include <string_view>
#include <system_error>

#include "runtime/atomic_file.h"
#include "runtime/error.h"
#include "runtime/threads.h"

namespace slide {
namespace {

/// The rate as a fraction: exact for whole and NTSC rates, else in thousandths.
std::string rate(double fps) {
  const double ntsc = fps * 1001 / 1000;
  if (fps != std::round(fps) && std::abs(ntsc - std::round(ntsc)) < 1e-3) {
    return std::to_string(std::lround(ntsc) * 1000) + ":1001";
  }
  const long thousandths = std::lround(fps * 1000);
  const long divisor = std::gcd(thousandths, 1000L);
  return std::to_string(thousandths / divisor) + ":" + std::to_string(1000 / divisor);
}

/// For 1 <= v < 255.5, where the sum is exact as far as it decides: std::lround() is a call for each sample.
std::uint8_t rounded(float v) {
  const float next = v + 0.5F;
  return static_cast<std::uint8_t>(next);
}

void convert(const float* rgb, std::size_t count, std::uint8_t* y, std::uint8_t* cb, std::uint8_t* cr) {
  for (std::size_t i = 0; i < count; ++i) {
    std::array<float, 3> c{};
    for (std::size_t k = 0; k < 3; ++k) {
      const float v = rgb[3 * i + k];
      c[k] = v > 0 ? std::min(v, 1.0F) : 0.0F;
    }
    const float luma = 0.2126F * c[0] + 0.7152F * c[1] + 0.0722F * c[2];  // ITU-R BT.709-6, item 3.2
    y[i] = rounded(16 + 219 * luma);
    cb[i] = rounded(128 + 224 * (c[2] - luma) / 1.8556F);
    cr[i] = rounded(128 + 224 * (c[0] - luma) / 1.5748F);
  }
}

/// Where the stream goes: a file that appears when it is complete, or a descriptor that is written as it
/// comes.
class Destination {
 public:
  explicit Destination(const std::string& path) : path_(path) {
    std::error_code code;
    const auto type = std::filesystem::status(path, code).type();
    if (path == "-") {
      path_ = "standard output";
      descriptor_ = STDOUT_FILENO;
    } else if (type == std::filesystem::file_type::fifo || type == std::filesystem::file_type::character) {
      descriptor_ = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
      owned_ = true;
      if (descriptor_ < 0) failed();
    } else {
      file_ = std::make_unique<AtomicFile>(path);
    }
  }
  ~Destination() {
    if (owned_ && descriptor_ >= 0) ::close(descriptor_);
  }
  Destination(const Destination&) = delete;
  Destination& operator=(const Destination&) = delete;

  void write(std::span<const std::byte> bytes) {
    if (file_) return file_->write(bytes);
    while (!bytes.empty()) {
      const ssize_t n = ::write(descriptor_, bytes.data(), bytes.size());
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) failed();
      bytes = bytes.subspan(static_cast<std::size_t>(n));
    }
  }
  void finish() {
    if (file_) file_->commit();
  }

 private:
  [[noreturn]] void failed() const {
    throw Error(ErrorKind::kOutput,
                "cannot write to " + path_ + ": " + std::generic_category().message(errno));
  }

  std::string path_;
  std::unique_ptr<AtomicFile> file_;
  int descriptor_ = -1;
  bool owned_ = false;
};

class Y4mSink : public FrameSink {
 public:
  explicit Y4mSink(const std::string& path) : path_(path) {}

 private:
  void do_begin() override {
    destination_ = std::make_unique<Destination>(path_);
    const std::string header = y4m_header(format());
    destination_->write(std::as_bytes(std::span(header)));
  }
  void do_frame(const Image& image) override {
    const std::vector<std::uint8_t> bytes = y4m_frame(image);
    destination_->write(std::as_bytes(std::span(bytes)));
  }
  void do_finish() override { destination_->finish(); }

  std::string path_;
  std::unique_ptr<Destination> destination_;
};

}  // namespace

std::string y4m_header(const FrameFormat& format) {
  return "YUV4MPEG2 W" + std::to_string(format.width) + " H" + std::to_string(format.height) + " F" +
         rate(format.fps) + " Ip A1:1 C444 XCOLORRANGE=LIMITED\n";
}

std::vector<std::uint8_t> y4m_frame(const Image& image) {
  constexpr std::string_view kMark = "FRAME\n";
  const std::size_t n = image.pixels();
  std::vector<std::uint8_t> bytes(kMark.size() + 3 * n);
  std::copy(kMark.begin(), kMark.end(), bytes.begin());
  std::uint8_t* planes = bytes.data() + kMark.size();
  const auto width = static_cast<std::size_t>(image.width);
  parallel_for(image.height, [&](std::int64_t row) {
    const std::size_t at = static_cast<std::size_t>(row) * width;
    convert(image.data.data() + 3 * at, width, planes + at, planes + n + at, planes + 2 * n + at);
  });
  return bytes;
}

std::unique_ptr<FrameSink> make_y4m_sink(const std::string& path) { return std::make_unique<Y4mSink>(path); }

}  // namespace slide
