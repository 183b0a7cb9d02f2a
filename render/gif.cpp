#include "render/gif.h"

#include <algorithm>
#include <cerrno>
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
// By how much the squared error of a pixel (of three channels of 0 to 255) may grow for a smaller file: 7
// levels a channel. On a photo it halves the file and costs 3 dB.
constexpr int kTolerance = 150;
constexpr int kNoColour = 1 << 20;
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

/// GIF's LZW. Where no string in the table goes on with the next symbol, `substitute(strings, position)` may
/// name another symbol that one does go on with, strings[symbol] being nonzero for those; -1: none will do.
template <typename Substitute>
std::vector<std::uint8_t> lzw(std::span<const std::uint8_t> symbols, const Substitute& substitute) {
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
  for (std::size_t i = 1; i < symbols.size(); ++i) {
    const std::uint8_t symbol = symbols[i];
    const std::size_t strings = static_cast<std::size_t>(current) * 256;
    std::uint16_t& child = children[strings + symbol];
    if (child != 0) {
      current = child;
      continue;
    }
    const int other = substitute(std::span<const std::uint16_t, 256>(&children[strings], 256), i);
    if (other >= 0) {
      current = children[strings + static_cast<std::size_t>(other)];
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

/// What one frame's rectangle should show, and what shows there before it.
struct Wanted {
  std::vector<std::uint8_t> rgb;     ///< 3 bytes a pixel
  std::vector<std::uint8_t> before;  ///< palette indices
};

/// Squared distance between what a symbol shows at a pixel and what should be seen there.
int shown_error(const std::vector<Rgb8>& palette, const Wanted& wanted, std::uint8_t symbol, std::size_t i) {
  const std::size_t colour = symbol == kTransparent ? wanted.before[i] : symbol;
  if (colour >= palette.size()) return kNoColour;
  int sum = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const int d = palette[colour][c] - wanted.rgb[3 * i + c];
    sum += d * d;
  }
  return sum;
}

/// LZW that may show a slightly different colour where a longer string of the table does. `symbols` becomes
/// what was written.
std::vector<std::uint8_t> lzw_nearly(std::vector<std::uint8_t>& symbols, const std::vector<Rgb8>& palette,
                                     const Wanted& wanted) {
  const auto substitute = [&](std::span<const std::uint16_t, 256> strings, std::size_t i) {
    if (symbols[i] == kTransparent) return -1;  // what stands still must not flicker
    int best = -1;
    int least = shown_error(palette, wanted, symbols[i], i) + kTolerance;
    for (unsigned symbol = 0; symbol < 256; ++symbol) {
      if (strings[symbol] == 0) continue;
      const int error = shown_error(palette, wanted, static_cast<std::uint8_t>(symbol), i);
      if (error > least) continue;
      least = error;
      best = static_cast<int>(symbol);
    }
    if (best >= 0) symbols[i] = static_cast<std::uint8_t>(best);
    return best;
  };
  return lzw(symbols, substitute);
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
    throw Error(kind_of_failure(errno, ErrorKind::kOutput),
                "cannot keep the frames of " + path_ + " in a temporary file",
                "make room in the folder for temporary files, or ask for fewer or smaller frames");
  }
  /// In 1/100 s, so that frame i ends at the hundredth nearest to (i + 1) / fps.
  [[nodiscard]] int delay(int i) const {
    const auto ends = [this](int frame) { return std::lround(frame * 100.0 / format().fps); };
    return static_cast<int>(std::clamp(ends(i + 1) - ends(i), 2L, 65535L));
  }
  void encode(std::vector<std::uint8_t>& out, int i, std::span<const std::uint8_t> rgb,
              std::vector<std::uint8_t> now, std::vector<std::uint8_t>& shown,
              const std::vector<Rgb8>& palette) const;

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

/// Appends frame i, and makes `shown` what is seen after it.
void GifSink::encode(std::vector<std::uint8_t>& out, int i, std::span<const std::uint8_t> rgb,
                     std::vector<std::uint8_t> now, std::vector<std::uint8_t>& shown,
                     const std::vector<Rgb8>& palette) const {
  const int width = format().width;
  if (i == 0) {
    put_frame(out, {0, 0, width, format().height}, delay(i), lzw_compress(now));
    shown = std::move(now);
    return;
  }
  const Wanted all{{rgb.begin(), rgb.end()}, shown};
  for (std::size_t p = 0; p < now.size(); ++p)
    if (shown_error(palette, all, kTransparent, p) <= shown_error(palette, all, now[p], p) + kTolerance)
      now[p] = shown[p];
  const Rect r = changed_rect(shown, now, width, format().height);
  const Wanted wanted{cut(rgb, 3 * width, {3 * r.x0, r.y0, 3 * r.x1, r.y1}), cut(shown, width, r)};
  std::vector<std::uint8_t> symbols = cut(now, width, r);
  for (std::size_t p = 0; p < symbols.size(); ++p)
    if (symbols[p] == wanted.before[p]) symbols[p] = kTransparent;
  put_frame(out, r, delay(i), lzw_nearly(symbols, palette, wanted));
  auto symbol = symbols.begin();
  for (int y = r.y0; y < r.y1; ++y)
    for (int x = r.x0; x < r.x1; ++x, ++symbol)
      if (*symbol != kTransparent)
        shown[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)] =
            *symbol;
}

void GifSink::do_finish() {
  const std::vector<Rgb8> palette = make_palette(histogram_, kPaletteSize);
  PatternDither dither(palette);
  const auto pixels = static_cast<std::size_t>(format().width) * static_cast<std::size_t>(format().height);
  std::vector<std::uint8_t> rgb(3 * pixels);
  std::vector<std::uint8_t> shown(pixels);
  std::vector<std::uint8_t> now(pixels);
  const std::vector<std::uint8_t> head = header(format(), palette);
  file_->write(std::as_bytes(std::span(head)));
  std::rewind(spool_.get());
  for (int i = 0; i < format().count; ++i) {
    if (std::fread(rgb.data(), 1, rgb.size(), spool_.get()) != rgb.size()) spool_failed();
    dither.map(rgb, format().width, now);
    std::vector<std::uint8_t> bytes;
    encode(bytes, i, rgb, now, shown, palette);
    file_->write(std::as_bytes(std::span(bytes)));
  }
  file_->write(";");
  file_->commit();
}

}  // namespace

std::vector<std::uint8_t> lzw_compress(std::span<const std::uint8_t> symbols) {
  return lzw(symbols, [](std::span<const std::uint16_t, 256>, std::size_t) { return -1; });
}

std::unique_ptr<FrameSink> make_gif_sink(const std::string& path) { return std::make_unique<GifSink>(path); }

}  // namespace slide
