#include "render/gif.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "render/codec.h"
#include "render/palette.h"
#include "runtime/atomic_file.h"
#include "runtime/error.h"

namespace slide {
namespace {

constexpr std::uint8_t kTransparent = 255;
constexpr int kPaletteSize = 255;
constexpr std::size_t kMaxSide = 65535;

class BitWriter {
 public:
  void put(unsigned code, unsigned bits) {
    pending_ |= code << filled_;
    filled_ += bits;
    while (filled_ >= 8) flush_byte();
  }
  std::vector<std::uint8_t> finish() {
    while (filled_ > 0) flush_byte();
    return std::move(bytes_);
  }

 private:
  void flush_byte() {
    bytes_.push_back(static_cast<std::uint8_t>(pending_ & 0xFFU));
    pending_ >>= 8U;
    filled_ = filled_ > 8 ? filled_ - 8 : 0;
  }

  std::vector<std::uint8_t> bytes_;
  unsigned pending_ = 0;
  unsigned filled_ = 0;
};

void put_u16(std::vector<std::uint8_t>& out, int v) {
  out.push_back(static_cast<std::uint8_t>(v & 0xFF));
  out.push_back(static_cast<std::uint8_t>(v >> 8 & 0xFF));
}

void put_text(std::vector<std::uint8_t>& out, const char* text) {
  while (*text != '\0') out.push_back(static_cast<std::uint8_t>(*text++));
}

std::vector<std::uint8_t> header(const FrameFormat& format, const std::vector<Rgb8>& palette) {
  std::vector<std::uint8_t> out;
  put_text(out, "GIF89a");
  put_u16(out, format.width);
  put_u16(out, format.height);
  out.insert(out.end(), {0xF7, 0, 0});  // a global table of 256 colours, 8 bits a channel
  for (std::size_t i = 0; i < 256; ++i) {
    const Rgb8 colour = i < palette.size() ? palette[i] : Rgb8{0, 0, 0};
    out.insert(out.end(), colour.begin(), colour.end());
  }
  out.insert(out.end(), {0x21, 0xFF, 11});
  put_text(out, "NETSCAPE2.0");
  out.insert(out.end(), {3, 1, 0, 0, 0});  // repeat without end
  return out;
}

struct Rect {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  // half-open
};

/// What differs between two frames; one pixel if nothing does, since a frame must hold one.
Rect changed_rect(std::span<const std::uint8_t> a, std::span<const std::uint8_t> b, int width, int height) {
  Rect r{width, height, 0, 0};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const auto i =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
      if (a[i] == b[i]) continue;
      r = {std::min(r.x0, x), std::min(r.y0, y), std::max(r.x1, x + 1), std::max(r.y1, y + 1)};
    }
  }
  return r.x1 == 0 ? Rect{0, 0, 1, 1} : r;
}

std::vector<std::uint8_t> cut(std::span<const std::uint8_t> indices, int width, const Rect& r) {
  std::vector<std::uint8_t> out;
  for (int y = r.y0; y < r.y1; ++y) {
    const auto row = indices.subspan(static_cast<std::size_t>(y) * static_cast<std::size_t>(width));
    out.insert(out.end(), row.begin() + r.x0, row.begin() + r.x1);
  }
  return out;
}

void put_frame(std::vector<std::uint8_t>& out, const Rect& r, int delay, std::span<const std::uint8_t> lzw) {
  out.insert(out.end(), {0x21, 0xF9, 4, 0x05});  // leave in place, with a transparent colour
  put_u16(out, delay);
  out.insert(out.end(), {kTransparent, 0, 0x2C});
  put_u16(out, r.x0);
  put_u16(out, r.y0);
  put_u16(out, r.x1 - r.x0);
  put_u16(out, r.y1 - r.y0);
  out.insert(out.end(), {0, 8});  // no table of its own; 8-bit symbols
  for (std::size_t i = 0; i < lzw.size(); i += 255) {
    const auto block = lzw.subspan(i, std::min<std::size_t>(255, lzw.size() - i));
    out.push_back(static_cast<std::uint8_t>(block.size()));
    out.insert(out.end(), block.begin(), block.end());
  }
  out.push_back(0);
}

class GifSink : public FrameSink {
 public:
  explicit GifSink(const std::string& path) : path_(path) {}

 private:
  using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;

  void do_begin() override;
  void do_frame(const Image& image) override;
  void do_finish() override;
  [[noreturn]] void spool_failed() const {
    throw Error(ErrorKind::kUsage, "cannot keep the frames of " + path_ + " in a temporary file",
                "make room in the folder for temporary files, or ask for fewer or smaller frames");
  }
  /// In 1/100 s, so that frame i ends at the hundredth nearest to (i + 1) / fps.
  [[nodiscard]] int delay(int i) const {
    const auto ends = [this](int frame) { return std::lround(frame * 100.0 / format().fps); };
    return static_cast<int>(std::clamp(ends(i + 1) - ends(i), 2L, 65535L));
  }
  void encode(std::vector<std::uint8_t>& out, int i, std::span<const std::uint8_t> before,
              std::span<const std::uint8_t> now) const;

  std::string path_;
  std::unique_ptr<AtomicFile> file_;
  File spool_{nullptr, &std::fclose};
  ColourHistogram histogram_;
};

void GifSink::do_begin() {
  if (format().fps > 50) {
    throw Error(ErrorKind::kUsage, "a GIF shows at most 50 frames per second", "set a lower frame rate");
  }
  if (std::max(format().width, format().height) > static_cast<int>(kMaxSide)) {
    throw Error(ErrorKind::kUsage, "a GIF has at most 65535 pixels a side", "make the frames smaller");
  }
  file_ = std::make_unique<AtomicFile>(path_);
  spool_.reset(std::tmpfile());
  if (!spool_) spool_failed();
}

void GifSink::do_frame(const Image& image) {
  const std::vector<std::uint8_t> rgb = to_samples(image, 8);
  histogram_.add(rgb);
  if (std::fwrite(rgb.data(), 1, rgb.size(), spool_.get()) != rgb.size()) spool_failed();
}

void GifSink::encode(std::vector<std::uint8_t>& out, int i, std::span<const std::uint8_t> before,
                     std::span<const std::uint8_t> now) const {
  const int width = format().width;
  if (i == 0) return put_frame(out, {0, 0, width, format().height}, delay(i), lzw_compress(now));
  const Rect r = changed_rect(before, now, width, format().height);
  const std::vector<std::uint8_t> whole = cut(now, width, r);
  const std::vector<std::uint8_t> old = cut(before, width, r);
  std::vector<std::uint8_t> changes = whole;
  for (std::size_t p = 0; p < changes.size(); ++p) {
    if (whole[p] == old[p]) changes[p] = kTransparent;
  }
  const std::vector<std::uint8_t> lzw_whole = lzw_compress(whole);
  const std::vector<std::uint8_t> lzw_changes = lzw_compress(changes);
  put_frame(out, r, delay(i), lzw_changes.size() < lzw_whole.size() ? lzw_changes : lzw_whole);
}

void GifSink::do_finish() {
  const std::vector<Rgb8> palette = make_palette(histogram_, kPaletteSize);
  PatternDither dither(palette);
  const auto pixels = static_cast<std::size_t>(format().width) * static_cast<std::size_t>(format().height);
  std::vector<std::uint8_t> rgb(3 * pixels);
  std::vector<std::uint8_t> before(pixels);
  std::vector<std::uint8_t> now(pixels);
  const std::vector<std::uint8_t> head = header(format(), palette);
  file_->write(std::as_bytes(std::span(head)));
  std::rewind(spool_.get());
  for (int i = 0; i < format().count; ++i) {
    if (std::fread(rgb.data(), 1, rgb.size(), spool_.get()) != rgb.size()) spool_failed();
    dither.map(rgb, format().width, now);
    std::vector<std::uint8_t> bytes;
    encode(bytes, i, before, now);
    file_->write(std::as_bytes(std::span(bytes)));
    before.swap(now);
  }
  file_->write(";");
  file_->commit();
}

}  // namespace

std::vector<std::uint8_t> lzw_compress(std::span<const std::uint8_t> symbols) {
  constexpr unsigned kClear = 256;
  constexpr unsigned kEnd = 257;
  constexpr unsigned kFirstFree = 258;
  constexpr unsigned kTableSize = 4096;
  // children[code * 256 + symbol] is the code of that string with the symbol appended; 0 stands for none,
  // which is no code of a longer string.
  std::vector<std::uint16_t> children(static_cast<std::size_t>(kTableSize) * 256, 0);
  BitWriter out;
  unsigned bits = 9;
  unsigned next = kFirstFree;
  out.put(kClear, bits);
  if (symbols.empty()) {
    out.put(kEnd, bits);
    return out.finish();
  }
  unsigned current = symbols[0];
  for (const std::uint8_t symbol : symbols.subspan(1)) {
    std::uint16_t& child = children[static_cast<std::size_t>(current) * 256 + symbol];
    if (child != 0) {
      current = child;
      continue;
    }
    out.put(current, bits);
    current = symbol;
    if (next < kTableSize) {
      child = static_cast<std::uint16_t>(next++);
      // The decoder is one string behind: it widens its codes when it has added the one before this.
      if (next > (1U << bits) && bits < 12) ++bits;
    } else {
      out.put(kClear, bits);
      std::fill(children.begin(), children.end(), std::uint16_t{0});
      bits = 9;
      next = kFirstFree;
    }
  }
  out.put(current, bits);
  // The decoder adds a string on reading that code, too, which can widen the end code.
  if (next < kTableSize && next + 1 > (1U << bits) && bits < 12) ++bits;
  out.put(kEnd, bits);
  return out.finish();
}

std::unique_ptr<FrameSink> make_gif_sink(const std::string& path) { return std::make_unique<GifSink>(path); }

}  // namespace slide
