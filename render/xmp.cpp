#include "render/xmp.h"

#include <algorithm>
#include <vector>

namespace slide {
namespace {

using Bytes = std::span<const std::uint8_t>;
using namespace std::string_view_literals;

constexpr std::string_view kPacket = "http://ns.adobe.com/xap/1.0/\0"sv;
constexpr std::string_view kExtension = "http://ns.adobe.com/xmp/extension/\0"sv;
constexpr std::size_t kGuidBytes = 32;

enum Marker : std::uint8_t { kRst0 = 0xD0, kRst7 = 0xD7, kEoi = 0xD9, kSos = 0xDA, kApp1 = 0xE1 };

std::string_view text_of(Bytes bytes) { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }

std::uint32_t big_endian(Bytes bytes) {
  std::uint32_t value = 0;
  for (const std::uint8_t b : bytes) value = value << 8U | b;
  return value;
}

/// Calls visit(marker, payload) for every segment up to and with the first scan's header.
/// @return where the first scan's data begins, or where the segments end
template <typename Visit>
std::size_t for_each_segment(Bytes jpeg, const Visit& visit) {
  std::size_t at = 2;  // behind the start marker
  while (at + 4 <= jpeg.size() && jpeg[at] == 0xFF) {
    const std::uint8_t marker = jpeg[at + 1];
    if (marker == 0xFF) {  // a fill byte
      ++at;
      continue;
    }
    const std::size_t length = big_endian(jpeg.subspan(at + 2, 2));
    if (marker == kEoi || length < 2 || length > jpeg.size() - at - 2) break;
    visit(marker, jpeg.subspan(at + 4, length - 2));
    at += 2 + length;
    if (marker == kSos) break;
  }
  return at;
}

/// A part of the extended packet.
struct Part {
  std::size_t offset;
  std::string_view text;
};

/// The parts put together; a gap ends it.
std::string joined(std::vector<Part> parts) {
  std::stable_sort(parts.begin(), parts.end(),
                   [](const Part& a, const Part& b) { return a.offset < b.offset; });
  std::string whole;
  for (const Part& part : parts)
    if (part.offset == whole.size()) whole += part.text;
  return whole;
}

bool is_space(char c) { return c == ' ' || c == '\n' || c == '\r' || c == '\t'; }

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && is_space(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_space(text.back())) text.remove_suffix(1);
  return text;
}

}  // namespace

std::string xmp_of_jpeg(Bytes jpeg) {
  std::string packet;
  std::vector<Bytes> extensions;
  for_each_segment(jpeg, [&](std::uint8_t marker, Bytes payload) {
    if (marker != kApp1) return;
    const std::string_view text = text_of(payload);
    if (text.starts_with(kPacket) && packet.empty()) packet = text.substr(kPacket.size());
    if (text.starts_with(kExtension)) extensions.push_back(payload.subspan(kExtension.size()));
  });
  const std::string guid(xmp_property(packet, "xmpNote:HasExtendedXMP"));
  std::vector<Part> parts;
  for (const Bytes& extension : extensions) {
    constexpr std::size_t kHead = kGuidBytes + 8;  // then the whole length, and this part's offset
    if (extension.size() > kHead && text_of(extension.first(kGuidBytes)) == guid)
      parts.push_back({big_endian(extension.subspan(kGuidBytes + 4, 4)), text_of(extension.subspan(kHead))});
  }
  return packet + joined(std::move(parts));
}

std::string_view xmp_property(std::string_view xmp, std::string_view name) {
  for (std::size_t at = xmp.find(name); at != std::string_view::npos; at = xmp.find(name, at + 1)) {
    if (at == 0) continue;
    const char before = xmp[at - 1];
    std::string_view rest = xmp.substr(at + name.size());
    if (before == '<' && rest.starts_with('>')) return trimmed(rest.substr(1, rest.substr(1).find('<')));
    if (!is_space(before)) continue;
    while (!rest.empty() && is_space(rest.front())) rest.remove_prefix(1);
    if (!rest.starts_with('=')) continue;
    rest.remove_prefix(1);
    while (!rest.empty() && is_space(rest.front())) rest.remove_prefix(1);
    if (rest.empty() || (rest.front() != '"' && rest.front() != '\'')) continue;
    return trimmed(rest.substr(1, rest.substr(1).find(rest.front())));
  }
  return {};
}

std::size_t jpeg_picture_bytes(Bytes jpeg) {
  // In a scan, 0xFF before anything but 0 and restart markers begins a segment (ITU-T T.81, section B.1.1).
  std::size_t at = for_each_segment(jpeg, [](std::uint8_t, Bytes) {});
  for (; at + 1 < jpeg.size(); ++at) {
    if (jpeg[at] != 0xFF) continue;
    const std::uint8_t marker = jpeg[at + 1];
    if (marker == kEoi) return at + 2;
    if (marker == 0 || marker == 0xFF || (marker >= kRst0 && marker <= kRst7)) continue;
    if (at + 4 > jpeg.size()) break;
    at += 1 + big_endian(jpeg.subspan(at + 2, 2));
  }
  return jpeg.size();
}

}  // namespace slide
