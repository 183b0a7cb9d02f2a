#include "tests/render/decoders.h"

#include <zlib.h>

#include <array>
#include <cstdlib>
#include <stdexcept>

namespace {

using Bytes = std::span<const std::uint8_t>;

void require(bool condition, const char* what) {
  if (!condition) throw std::runtime_error(what);
}

std::uint32_t u32(Bytes b, std::size_t at) {
  require(at + 4 <= b.size(), "too short");
  return static_cast<std::uint32_t>(b[at]) << 24U | static_cast<std::uint32_t>(b[at + 1]) << 16U |
         static_cast<std::uint32_t>(b[at + 2]) << 8U | b[at + 3];
}

int u16_little(Bytes b, std::size_t at) {
  require(at + 2 <= b.size(), "too short");
  return b[at] | b[at + 1] << 8;
}

struct Chunk {
  std::string type;
  Bytes data;
};

std::vector<Chunk> chunks_of(Bytes bytes) {
  const std::array<std::uint8_t, 8> signature = {137, 80, 78, 71, 13, 10, 26, 10};
  require(bytes.size() > 8 && std::equal(signature.begin(), signature.end(), bytes.begin()),
          "no PNG signature");
  std::vector<Chunk> chunks;
  std::size_t at = 8;
  while (at < bytes.size()) {
    const std::size_t length = u32(bytes, at);
    require(at + 12 + length <= bytes.size(), "a chunk is too long");
    const Bytes covered = bytes.subspan(at + 4, 4 + length);
    require(u32(bytes, at + 8 + length) == crc32(0, covered.data(), static_cast<uInt>(covered.size())),
            "CRC");
    chunks.push_back({std::string(covered.begin(), covered.begin() + 4), covered.subspan(4)});
    at += 12 + length;
  }
  require(!chunks.empty() && chunks.back().type == "IEND", "no IEND");
  return chunks;
}

int paeth(int a, int b, int c) {
  const int p = a + b - c;
  const int pa = std::abs(p - a);
  const int pb = std::abs(p - b);
  const int pc = std::abs(p - c);
  return pa <= pb && pa <= pc ? a : pb <= pc ? b : c;
}

DecodedPng decode_data(const Chunk& header, const std::vector<std::uint8_t>& compressed) {
  DecodedPng out;
  out.width = static_cast<int>(u32(header.data, 0));
  out.height = static_cast<int>(u32(header.data, 4));
  out.bits = header.data[8];
  const std::array<int, 7> channels = {1, 0, 3, 1, 2, 0, 4};
  out.channels = channels.at(header.data[9]);
  require(out.bits >= 8 && header.data[9] != 3 && header.data[12] == 0, "a PNG kind these tests do not need");
  const std::size_t step = static_cast<std::size_t>(out.channels * out.bits / 8);
  const std::size_t stride = step * static_cast<std::size_t>(out.width);
  std::vector<std::uint8_t> raw((stride + 1) * static_cast<std::size_t>(out.height));
  uLongf size = static_cast<uLongf>(raw.size());
  require(uncompress(raw.data(), &size, compressed.data(), static_cast<uLong>(compressed.size())) == Z_OK,
          "zlib");
  require(size == raw.size(), "the number of samples");
  std::vector<std::uint8_t> above(stride, 0);
  for (std::size_t y = 0; y < static_cast<std::size_t>(out.height); ++y) {
    const int filter = raw[y * (stride + 1)];
    std::vector<std::uint8_t> row(raw.begin() + static_cast<std::ptrdiff_t>(y * (stride + 1) + 1),
                                  raw.begin() + static_cast<std::ptrdiff_t>((y + 1) * (stride + 1)));
    for (std::size_t i = 0; i < stride; ++i) {
      const int left = i >= step ? row[i - step] : 0;
      const int corner = i >= step ? above[i - step] : 0;
      const std::array<int, 5> predictions = {0, left, above[i], (left + above[i]) / 2,
                                              paeth(left, above[i], corner)};
      row[i] = static_cast<std::uint8_t>(row[i] + predictions.at(static_cast<std::size_t>(filter)));
    }
    for (std::size_t i = 0; i < stride; i += static_cast<std::size_t>(out.bits) / 8) {
      out.samples.push_back(static_cast<std::uint16_t>(out.bits == 16 ? row[i] << 8 | row[i + 1] : row[i]));
    }
    above = row;
  }
  return out;
}

/// The string of a code: the symbols from the chain of prefixes, in order.
struct Lzw {
  struct Entry {
    int prefix;
    std::uint8_t symbol;
  };
  std::vector<Entry> table;

  [[nodiscard]] std::vector<std::uint8_t> string_of(int code) const {
    std::vector<std::uint8_t> reversed;
    for (int c = code; c >= 0; c = table.at(static_cast<std::size_t>(c)).prefix) {
      reversed.push_back(table.at(static_cast<std::size_t>(c)).symbol);
    }
    return {reversed.rbegin(), reversed.rend()};
  }
  void clear() {
    table.clear();
    for (int i = 0; i < 258; ++i) table.push_back({-1, static_cast<std::uint8_t>(i & 255)});
  }
};

struct GifReader {
  Bytes bytes;
  std::size_t at = 0;
  std::uint8_t take() {
    require(at < bytes.size(), "the GIF ends too early");
    return bytes[at++];
  }
  int take16() {
    const int v = u16_little(bytes, at);
    at += 2;
    return v;
  }
  std::vector<std::uint8_t> take_blocks() {
    std::vector<std::uint8_t> out;
    while (const int length = take()) {
      for (int i = 0; i < length; ++i) out.push_back(take());
    }
    return out;
  }
};

}  // namespace

std::vector<std::uint8_t> independent_lzw(Bytes bytes, std::size_t symbols) {
  std::vector<std::uint8_t> out;
  Lzw lzw;
  lzw.clear();
  int bits = 9;
  int previous = -1;
  std::size_t position = 0;
  for (;;) {
    int code = 0;
    for (int i = 0; i < bits; ++i, ++position) {
      require(position / 8 < bytes.size(), "LZW ends without an end code");
      code |= (bytes[position / 8] >> position % 8 & 1) << i;
    }
    if (code == 256) {
      lzw.clear();
      bits = 9;
      previous = -1;
      continue;
    }
    if (code == 257) break;
    const int next = static_cast<int>(lzw.table.size());
    require(code < next || (code == next && previous >= 0), "LZW code out of range");
    const std::uint8_t first = lzw.string_of(code < next ? code : previous).front();
    if (previous >= 0 && next < 4096) lzw.table.push_back({previous, first});
    const std::vector<std::uint8_t> text = lzw.string_of(code);
    out.insert(out.end(), text.begin(), text.end());
    previous = code;
    if (lzw.table.size() == (std::size_t{1} << bits) && bits < 12) ++bits;
  }
  require((position + 7) / 8 == bytes.size(), "bytes after the LZW end code");
  require(out.size() == symbols, "the number of LZW symbols");
  return out;
}

DecodedPng independent_png(Bytes bytes) {
  const std::vector<Chunk> chunks = chunks_of(bytes);
  std::vector<std::uint8_t> compressed;
  for (const Chunk& c : chunks) {
    if (c.type == "IDAT") compressed.insert(compressed.end(), c.data.begin(), c.data.end());
  }
  return decode_data(chunks.front(), compressed);
}

DecodedApng independent_apng(Bytes bytes) {
  const std::vector<Chunk> chunks = chunks_of(bytes);
  DecodedApng out;
  std::vector<std::uint8_t> compressed;
  std::uint32_t announced = 0;
  std::uint32_t sequence = 0;
  const auto complete = [&] {
    if (!compressed.empty()) out.frames.push_back(decode_data(chunks.front(), compressed));
    compressed.clear();
  };
  for (const Chunk& c : chunks) {
    if (c.type == "acTL") {
      announced = u32(c.data, 0);
      out.plays = u32(c.data, 4);
    } else if (c.type == "fcTL") {
      complete();
      require(u32(c.data, 0) == sequence++, "fcTL sequence");
      require(u32(c.data, 4) == u32(chunks.front().data, 0) && u32(c.data, 8) == u32(chunks.front().data, 4),
              "size");
      require(u32(c.data, 12) == 0 && u32(c.data, 16) == 0 && c.data.size() == 26, "fcTL");
      out.delay_numerators.push_back(c.data[20] << 8 | c.data[21]);
      out.delay_denominators.push_back(c.data[22] << 8 | c.data[23]);
    } else if (c.type == "IDAT") {
      require(announced > 0 && out.frames.empty(), "IDAT out of order");
      compressed.insert(compressed.end(), c.data.begin(), c.data.end());
    } else if (c.type == "fdAT") {
      require(u32(c.data, 0) == sequence++, "fdAT sequence");
      compressed.insert(compressed.end(), c.data.begin() + 4, c.data.end());
    }
  }
  complete();
  require(out.frames.size() == announced, "the number of frames");
  return out;
}

DecodedGif independent_gif(Bytes bytes) {
  GifReader r{bytes};
  const std::string version(bytes.begin(), bytes.begin() + 6);
  require(version == "GIF89a", "version");
  r.at = 6;
  DecodedGif out;
  out.width = r.take16();
  out.height = r.take16();
  require(r.take() == 0xF7, "a global table of 256 colours");
  r.at += 2;
  const Bytes table = bytes.subspan(r.at, 768);
  r.at += 768;
  std::vector<std::uint8_t> shown(static_cast<std::size_t>(out.width * out.height * 3), 0);
  int transparent = -1;
  for (int mark = r.take(); mark != 0x3B; mark = r.take()) {
    if (mark == 0x21) {
      const int label = r.take();
      const std::vector<std::uint8_t> block = r.take_blocks();
      if (label == 0xFF) out.loops = u16_little(block, 12);
      if (label != 0xF9) continue;
      out.delays.push_back(u16_little(block, 1));
      require((block[0] >> 2 & 7) == 1, "disposal");
      transparent = (block[0] & 1) != 0 ? block[3] : -1;
      continue;
    }
    require(mark == 0x2C, "an unknown block");
    const int x0 = r.take16();
    const int y0 = r.take16();
    const int w = r.take16();
    const int h = r.take16();
    require(r.take() == 0 && r.take() == 8 && x0 + w <= out.width && y0 + h <= out.height,
            "an image descriptor");
    const std::vector<std::uint8_t> indices =
        independent_lzw(r.take_blocks(), static_cast<std::size_t>(w * h));
    for (int i = 0; i < w * h; ++i) {
      const int index = indices[static_cast<std::size_t>(i)];
      if (index == transparent) continue;
      const auto to = static_cast<std::size_t>(((y0 + i / w) * out.width + x0 + i % w) * 3);
      for (std::size_t c = 0; c < 3; ++c) shown[to + c] = table[static_cast<std::size_t>(index) * 3 + c];
    }
    out.frames.push_back(shown);
  }
  require(r.at == bytes.size(), "bytes after the trailer");
  return out;
}
