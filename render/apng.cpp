#include "render/apng.h"

#include <zlib.h>

#include <cmath>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "render/codec.h"
#include "runtime/atomic_file.h"
#include "runtime/error.h"

namespace slide {
namespace {

constexpr std::size_t kSignatureBytes = 8;

void put_u16(std::vector<std::uint8_t>& out, unsigned v) {
  out.push_back(static_cast<std::uint8_t>(v >> 8U & 0xFFU));
  out.push_back(static_cast<std::uint8_t>(v & 0xFFU));
}

void put_u32(std::vector<std::uint8_t>& out, std::uint32_t v) {
  put_u16(out, v >> 16U);
  put_u16(out, v & 0xFFFFU);
}

std::uint32_t get_u32(std::span<const std::uint8_t> bytes) {
  return static_cast<std::uint32_t>(bytes[0]) << 24U | static_cast<std::uint32_t>(bytes[1]) << 16U |
         static_cast<std::uint32_t>(bytes[2]) << 8U | bytes[3];
}

void put_chunk(std::vector<std::uint8_t>& out, std::string_view type, std::span<const std::uint8_t> data) {
  put_u32(out, static_cast<std::uint32_t>(data.size()));
  const std::size_t begin = out.size();
  out.insert(out.end(), type.begin(), type.end());
  out.insert(out.end(), data.begin(), data.end());
  const uLong crc = crc32(crc32(0, nullptr, 0), out.data() + begin, static_cast<uInt>(out.size() - begin));
  put_u32(out, static_cast<std::uint32_t>(crc));
}

/// Calls visit(type, data) for the chunks of a PNG that encode_png has made.
template <typename Visit>
void for_each_chunk(std::span<const std::uint8_t> png, const Visit& visit) {
  std::span<const std::uint8_t> rest = png.subspan(kSignatureBytes);
  while (rest.size() >= 12) {
    const std::size_t length = get_u32(rest);
    const auto type = rest.subspan(4, 4);
    visit(std::string_view(reinterpret_cast<const char*>(type.data()), 4), rest.subspan(8, length));
    rest = rest.subspan(12 + length);
  }
}

struct Delay {
  unsigned numerator, denominator;
};

/// 1/fps as a fraction of 16-bit numbers: exact for whole rates up to 1000 and for NTSC's, else to a
/// microsecond or 1/65535.
Delay frame_delay(double fps) {
  if (fps == std::round(fps)) return {1, static_cast<unsigned>(fps)};
  const double ntsc = fps * 1001 / 1000;
  if (std::abs(ntsc - std::round(ntsc)) < 1e-3 && ntsc < 65) {
    return {1001, static_cast<unsigned>(std::lround(ntsc)) * 1000};
  }
  const double seconds = 1 / fps;
  const double denominator = std::min(10000.0, std::floor(65535 / seconds));
  return {static_cast<unsigned>(std::lround(seconds * denominator)), static_cast<unsigned>(denominator)};
}

class ApngSink : public FrameSink {
 public:
  explicit ApngSink(const std::string& path) : path_(path) {}

 private:
  void do_begin() override {
    file_ = std::make_unique<AtomicFile>(path_);
    sequence_ = 0;
  }
  void do_frame(const Image& image) override;
  void do_finish() override {
    std::vector<std::uint8_t> end;
    if (format().count > 1) put_chunk(end, "IEND", {});
    file_->write(std::as_bytes(std::span(end)));
    file_->commit();
  }
  void put_frame_control(std::vector<std::uint8_t>& out);

  std::string path_;
  std::unique_ptr<AtomicFile> file_;
  std::uint32_t sequence_ = 0;  // fcTL and fdAT chunks are counted together
};

void ApngSink::put_frame_control(std::vector<std::uint8_t>& out) {
  std::vector<std::uint8_t> control;
  put_u32(control, sequence_++);
  put_u32(control, static_cast<std::uint32_t>(format().width));
  put_u32(control, static_cast<std::uint32_t>(format().height));
  put_u32(control, 0);
  put_u32(control, 0);
  const Delay delay = frame_delay(format().fps);
  put_u16(control, delay.numerator);
  put_u16(control, delay.denominator);
  control.insert(control.end(), {0, 0});  // leave in place, replace
  put_chunk(out, "fcTL", control);
}

void ApngSink::do_frame(const Image& image) {
  const std::vector<std::uint8_t> png = encode_png(image, 8);
  if (format().count == 1) return file_->write(std::as_bytes(std::span(png)));
  const bool first = frames_before() == 0;
  std::vector<std::uint8_t> out;
  if (first) {
    out.assign(png.begin(), png.begin() + kSignatureBytes);
    for_each_chunk(png, [&](std::string_view type, std::span<const std::uint8_t> data) {
      if (type == "IHDR" || type == "tEXt") put_chunk(out, type, data);
    });
    std::vector<std::uint8_t> animation;
    put_u32(animation, static_cast<std::uint32_t>(format().count));
    put_u32(animation, 0);  // repeat without end
    put_chunk(out, "acTL", animation);
  }
  put_frame_control(out);
  for_each_chunk(png, [&](std::string_view type, std::span<const std::uint8_t> data) {
    if (type != "IDAT") return;
    if (first) return put_chunk(out, "IDAT", data);
    std::vector<std::uint8_t> numbered;
    put_u32(numbered, sequence_++);
    numbered.insert(numbered.end(), data.begin(), data.end());
    put_chunk(out, "fdAT", numbered);
  });
  file_->write(std::as_bytes(std::span(out)));
}

}  // namespace

std::unique_ptr<FrameSink> make_apng_sink(const std::string& path) {
  return std::make_unique<ApngSink>(path);
}

}  // namespace slide
